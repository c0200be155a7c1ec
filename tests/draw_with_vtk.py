"""draw_with_vtk.py MODEL PNG OUT.json: the board of test_round_trips as VTK draws it, one sample a texel.

Without a model it draws an empty, red picture.
"""

import json
import sys
from pathlib import Path

import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOImage import vtkPNGReader
from vtkmodules.vtkIOImport import vtkGLTFImporter, vtkOBJImporter
from vtkmodules.vtkIOPLY import vtkPLYReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader
from vtkmodules.vtkRenderingCore import (
    vtkActor,
    vtkPolyDataMapper,
    vtkRenderer,
    vtkRenderWindow,
    vtkTexture,
    vtkWindowToImageFilter,
)

*named, out = (Path(argument) for argument in sys.argv[1:])
model, picture = named or (Path(), Path())
ROWS, COLUMNS, STEP, SCALE = 13, 10, 10.0, 16
assert vtkmodules.vtkRenderingOpenGL2

renderer, window = vtkRenderer(), vtkRenderWindow()
window.SetOffScreenRendering(1)
window.SetSize(COLUMNS * SCALE, ROWS * SCALE)
window.AddRenderer(renderer)
renderer.SetBackground(1, 0, 0)
if model.suffix in (".vtp", ".ply"):
    reader, texture = vtkXMLPolyDataReader() if model.suffix == ".vtp" else vtkPLYReader(), vtkTexture()
    reader.SetFileName(str(model))
    source = vtkPNGReader()
    source.SetFileName(str(picture))
    texture.SetInputConnection(source.GetOutputPort())
    mapper, actor = vtkPolyDataMapper(), vtkActor()
    mapper.SetInputConnection(reader.GetOutputPort())
    mapper.ScalarVisibilityOff()  # the texture, not the colours of the vertices
    actor.SetMapper(mapper)
    actor.SetTexture(texture)
    renderer.AddActor(actor)
elif named:
    importer = vtkGLTFImporter() if model.suffix == ".glb" else vtkOBJImporter()
    importer.SetFileName(str(model))
    if model.suffix == ".obj":
        importer.SetFileNameMTL(str(model.with_suffix(".mtl")))
        importer.SetTexturePath(str(model.parent))
    importer.SetRenderWindow(window)
    importer.Update()

# Straight ahead and without perspective: one vertex in the middle of each square of SCALE pixels.
unit = 1e-3 if model.suffix == ".glb" else 1.0
middle = [(COLUMNS - 1) / 2 + 3, 4 - (ROWS - 1) / 2]
camera = renderer.MakeCamera()
renderer.SetActiveCamera(camera)
camera.SetParallelProjection(True)
camera.SetParallelScale(ROWS / 2 * STEP * unit)
camera.SetPosition(middle[0] * STEP * unit, middle[1] * STEP * unit, 0)
camera.SetFocalPoint(middle[0] * STEP * unit, middle[1] * STEP * unit, -unit)
camera.SetViewUp(0, 1, 0)
renderer.ResetCameraClippingRange()
window.Render()
grab = vtkWindowToImageFilter()
grab.SetInput(window)
grab.Update()
pixels = vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars())
drawn = pixels.reshape(ROWS * SCALE, COLUMNS * SCALE, 3)[::-1]  # VTK counts rows from below
sampled = drawn[SCALE // 2 :: SCALE, SCALE // 2 :: SCALE]
out.write_text(json.dumps(sampled.tolist()))
