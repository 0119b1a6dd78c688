"""Nesting of several pieces' panels on common sheets, to cut them together."""
