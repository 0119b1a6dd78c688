"""The layout: cutting a quad mesh into few patches that flatten with little distortion, and flattening them."""
