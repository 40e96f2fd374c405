"""Programs in processes of their own that are watched, or may die of what they do."""
