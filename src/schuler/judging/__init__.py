"""How good was it: errors, consistency."""
