"""The layout: cut a quad mesh into few patches that flatten with little distortion, and flatten them."""
