"""Writing files atomically, checking them when they are read, and safety against malicious content."""
