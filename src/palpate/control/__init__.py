"""Contacts become motion: admittance, alignment with what is touched, the limits and the states of a loop."""
