"""The static half of the `probe` paper: marks on three ultrasound probes, pressed and located."""
