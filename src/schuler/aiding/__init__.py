"""Navigation with help: filters, dead reckoning, smoothing."""
