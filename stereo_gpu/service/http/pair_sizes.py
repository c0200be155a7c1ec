"""Whether pictures can be a pair, and of a rig, by their headers: what the pipeline would say after decoding them."""

from __future__ import annotations

from stereo_gpu.errors import InputError, PictureError
from stereo_gpu.service.records import InputFile, RigRecord


def check_sizes_alike(left: InputFile, right: InputFile) -> None:
    """Refuse a pair of two sizes.

    Raises:
        PictureError: with both.
    """
    if (left.width, left.height) != (right.width, right.height):
        raise PictureError(
            f"left is {left.width} x {left.height} px, right is {right.width} x {right.height} px:"
            " give two pictures of one size, as the cameras took them"
        )


def check_size_of_rig(picture: InputFile, rig: RigRecord) -> None:
    """Refuse a picture that the rig's cameras cannot have taken.

    Raises:
        InputError: with both sizes.
    """
    width, height = rig.summary["width"], rig.summary["height"]
    if (picture.width, picture.height) != (width, height):
        raise InputError(
            f"the pictures are {picture.width} x {picture.height}, the rig was calibrated for {width} x {height}:"
            " use pictures of that size, or calibrate with pictures of this one"
        )


def check_size_of_mask(mask: InputFile, rig: RigRecord) -> None:
    """Refuse a mask that was not drawn on the rectified view.

    Raises:
        PictureError: with both sizes.
    """
    width, height = rig.summary["width"], rig.summary["height"]
    if (mask.width, mask.height) != (width, height):
        raise PictureError(
            f"mask is {mask.width} x {mask.height} px, the rectified picture is {width} x {height}:"
            " draw it on the rectified reference view"
        )


def check_one_size(side: str, pictures: list[InputFile]) -> None:
    """Refuse pictures of one camera that differ in size.

    Raises:
        PictureError: names the first that does.
    """
    first = pictures[0]
    for picture in pictures:
        if (picture.width, picture.height) != (first.width, first.height):
            raise PictureError(
                f"{side}: {picture.given or picture.name} is {picture.width} x {picture.height} px,"
                f" {first.given or first.name} is {first.width} x {first.height} px:"
                " give pictures of one camera, all of one size"
            )
