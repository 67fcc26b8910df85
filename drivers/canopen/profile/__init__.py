"""Rules of the profiles CiA 301 and CiA 402-2, each with its clause, tried on a drive."""
