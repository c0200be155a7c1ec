"""The compute: one folder a language, the same file, kernel and parameter names in both."""
