"""What a spec says about simulations. Nothing here has a say in a proof."""
