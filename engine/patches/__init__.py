"""The layout: cut a quad mesh into few patches that can be flattened with little distortion, and flatten them."""
