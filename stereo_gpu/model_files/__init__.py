"""The formats of models, one a module, and what they share."""
