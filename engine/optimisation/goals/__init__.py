"""Further terms of the objective, a module for each with its function ``goal``; ``goal_registry`` finds them."""
