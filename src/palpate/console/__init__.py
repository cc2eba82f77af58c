"""Messages, options, progress and interrupts that commands share."""
