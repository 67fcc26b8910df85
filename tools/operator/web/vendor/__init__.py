"""JavaScript of others that the page is served with, and how it is fetched."""
