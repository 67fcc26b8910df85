"""One payload held by several arms: the law of a joint task, and its promise along stops."""
