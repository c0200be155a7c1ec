"""How far disparity maps are from the truth: readers of truth, masks, scores, sparsification and pictures.

Nothing else in stereo_gpu imports this package; tools/evaluate.py and the tests do.
"""
