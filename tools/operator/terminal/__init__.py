"""An operator at a keyboard."""
