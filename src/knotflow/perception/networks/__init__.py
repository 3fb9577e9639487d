"""The network that proposes shapes of ropes, and its training."""
