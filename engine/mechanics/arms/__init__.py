"""The 6 x 6 arm model: stiffness table, motion and strains of the joints, and the arms' shape between hub and tip."""
