"""Show each sensor on the page and in the report: one file a sensor."""
