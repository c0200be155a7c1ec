"""What is said over HTTP: routes, documents, events, problems, headers."""
