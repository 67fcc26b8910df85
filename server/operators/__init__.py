"""Who may speak: the network, the lease, admission, and answers to requests."""
