"""Provide messages, options, progress and interrupts that commands share."""
