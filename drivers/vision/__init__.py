"""Pictures: from a camera, and what can be seen in them. The only place that knows OpenCV."""
