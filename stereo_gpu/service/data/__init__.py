"""The data folder: where everything lies, moved in one step, swept, audited."""
