"""Panels laid on sheets: quickly, or as tightly as a time limit allows."""
