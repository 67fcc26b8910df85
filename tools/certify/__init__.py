"""`telerobot certify`: a certificate authority for the cells' network."""
