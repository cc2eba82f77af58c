"""What page and report show of each sensor beside its contacts: one file a sensor."""
