"""Networks that propose shapes of ropes, and their training."""
