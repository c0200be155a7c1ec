"""The parts of the mesh's stages: triangles, borders, edges, and what they are measured with."""
