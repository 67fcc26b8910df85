"""A recorded run on a time line, in the browser."""
