"""Several pieces cut together: their panels on common sheets."""
