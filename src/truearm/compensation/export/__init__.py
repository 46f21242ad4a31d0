"""Exports of a model into the files of other programs: URDF, tables of constants, C, JavaScript, ONNX, JSON."""
