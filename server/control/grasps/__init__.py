"""Several mechanisms that hold one payload: load shares, internal forces, and views of its MRF."""
