"""`telerobot certify`: an authority, and a certificate for each who takes part in the network."""
