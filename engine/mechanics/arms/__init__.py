"""The 6 x 6 arm model: the stiffness table, how joints move, and the arms' shape between hub and tip."""
