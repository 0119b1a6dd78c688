"""What a piece stands on: feet that its panels end in, and plates with slots for them."""
