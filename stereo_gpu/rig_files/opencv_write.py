"""OpenCV's YAML and XML as cv2.FileStorage writes them, under the names of its stereo_calib sample."""

from __future__ import annotations

from stereo_gpu.rig import Rig


def write_opencv_yaml(rig: Rig) -> str:
    """The text of a YAML file that any OpenCV reads, with every digit."""
    lines = ["%YAML:1.0", "---"]
    for name, value in _content(rig):
        if isinstance(value, list):
            numbers = ", ".join(digits(number) for row in value for number in row)
            lines += [f"{name}: !!opencv-matrix", f"   rows: {len(value)}", f"   cols: {len(value[0])}", "   dt: d"]
            lines.append(f"   data: [ {numbers} ]")
        else:
            lines.append(f"{name}: {value if isinstance(value, str) else digits(value)}")
    return "\n".join(lines) + "\n"


def write_opencv_xml(rig: Rig) -> str:
    """The text of an XML file that any OpenCV reads, with every digit."""
    from xml.sax.saxutils import escape

    lines = ['<?xml version="1.0"?>', "<opencv_storage>"]
    for name, value in _content(rig):
        if isinstance(value, list):
            numbers = " ".join(digits(number) for row in value for number in row)
            lines += [f'<{name} type_id="opencv-matrix">', f"  <rows>{len(value)}</rows>"]
            lines += [f"  <cols>{len(value[0])}</cols>", "  <dt>d</dt>", f"  <data>{numbers}</data></{name}>"]
        else:
            lines.append(f"<{name}>{escape(value) if isinstance(value, str) else digits(value)}</{name}>")
    return "\n".join([*lines, "</opencv_storage>"]) + "\n"


def digits(value: float) -> str:
    """The shortest text that gives the same number back, with a point, without which YAML 1.1 sees a word in 1e-05."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _content(rig: Rig) -> list[tuple[str, str | float | list[list[float]]]]:
    """Names and values in the order of the sample, and what it leaves out."""
    content: list[tuple[str, str | float | list[list[float]]]] = []
    for side, camera in (("1", rig.left), ("2", rig.right)):
        content.append((f"M{side}", camera.matrix.tolist()))
        content.append((f"D{side}", [camera.distortion.tolist()]))
        content.append((f"rms_px{side}", camera.rms_px))
    content.append(("R", rig.R.tolist()))
    content.append(("T", [[value] for value in rig.T.tolist()]))
    ends = [("", rig.left.size)] if rig.left.size == rig.right.size else [("1", rig.left.size), ("2", rig.right.size)]
    for end, (width, height) in ends:
        content += [(f"image_width{end}", width), (f"image_height{end}", height)]
    return [*content, ("unit", rig.unit), ("rms_px", rig.rms_px), ("epipolar_rms_px", rig.epipolar_rms_px)]
