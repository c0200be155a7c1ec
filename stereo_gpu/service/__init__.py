"""The reconstruction service: pairs in over HTTP, models out, nothing lost."""
