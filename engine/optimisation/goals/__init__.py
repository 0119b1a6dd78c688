"""Additional terms of the objective, one in each module, made by its function ``goal``; found by ``goal_registry``."""
