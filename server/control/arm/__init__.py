"""One arm: a mechanism with its task, and what one tick makes of both."""
