"""Two-view geometry from matched points: no board, no rig."""
