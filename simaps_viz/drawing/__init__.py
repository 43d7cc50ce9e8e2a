"""Pictures of maps, without a viewer."""
