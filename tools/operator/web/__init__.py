"""Operator's console in the browser: a process that serves one page and speaks Zenoh behind it."""
