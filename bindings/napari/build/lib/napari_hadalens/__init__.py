"""Lensless cameras in napari: reads models and results, learns cameras, reconstructs frames."""
