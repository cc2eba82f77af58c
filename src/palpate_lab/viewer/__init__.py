"""Pages and pictures of the laboratory's arena and phantom."""
