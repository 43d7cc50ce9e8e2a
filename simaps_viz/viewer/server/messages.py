"""What a page of viser 1.1.1 may say to us, exactly; anything else is dropped before viser sees it.

viser itself would take any of its 122 messages from a page, and with `GuiUpdateMessage` any attribute of a widget.
"""

import itertools
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

LARGEST_MESSAGE = 1 << 20
"""Bytes; the largest honest ones are parts of an uploaded file, of 512 KiB."""
LARGEST_UPLOAD = 256 << 20
"""Bytes of one file, and of all that one page has uploaded or is uploading."""
MOST_UPLOADING = 1 << 30
"""Bytes, of all pages together."""
MOST_TRANSFERS = 16
"""Files that one page uploads at a time."""

Name = Annotated[str, Meta(max_length=256)]
Text = Annotated[str, Meta(max_length=100_000)]
Number = Annotated[float, Meta(ge=-1e12, le=1e12)]
Count = Annotated[int, Meta(ge=0, le=LARGEST_UPLOAD)]
Pixels = Annotated[int, Meta(ge=0, le=65_536)]
Vector = tuple[Number, Number, Number]
Modifier = Name | None
Items = Annotated[list[bool | int | Number | Name | None], Meta(max_length=64)]


class _Said(Struct, tag_field="type", forbid_unknown_fields=True):
    pass


class ViewerCamera(_Said, tag="ViewerCameraMessage"):
    """Where the page's camera is."""

    wxyz: tuple[Number, Number, Number, Number]
    position: Vector
    fov: Number
    near: Number
    far: Number
    image_height: Pixels
    image_width: Pixels
    look_at: Vector
    up_direction: Vector


class _Change(Struct, forbid_unknown_fields=True):
    value: bool | Annotated[int, Meta(ge=-(1 << 40), le=1 << 40)] | Number | Text | Items | None


class GuiUpdate(_Said, tag="GuiUpdateMessage"):
    """A widget has another value."""

    uuid: Name
    updates: _Change


class GuiButtonHold(_Said, tag="GuiButtonHoldMessage"):
    """A button is held down."""

    uuid: Name
    frequency: Number


class CommandTrigger(_Said, tag="CommandTriggerMessage"):
    """A key was pressed, or a command chosen."""

    uuid: Name


class ScenePointer(_Said, tag="ScenePointerMessage"):
    """The scene was clicked."""

    event_type: Literal["click", "rect-select"]
    ray_origin: Vector | None
    ray_direction: Vector | None
    screen_pos: Annotated[list[tuple[Number, Number]], Meta(max_length=2)]
    modifier: Modifier


class SceneNodeClick(_Said, tag="SceneNodeClickMessage"):
    """Something in the scene was clicked."""

    name: Name
    instance_index: int | None
    ray_origin: Vector
    ray_direction: Vector
    screen_pos: tuple[Number, Number]
    modifier: Modifier
    owner: Name = ""


class UploadStart(_Said, tag="FileTransferStartUpload"):
    """A file is about to be uploaded."""

    source_component_uuid: Name
    transfer_uuid: Name
    filename: Name
    mime_type: Name
    part_count: Annotated[int, Meta(ge=0, le=65_536)]
    size_bytes: Count


class UploadPart(_Said, tag="FileTransferPart"):
    """A part of an uploaded file."""

    source_component_uuid: Name | None
    transfer_uuid: Name
    part_index: Annotated[int, Meta(ge=0, le=65_536)]
    content: bytes


Said = (
    ViewerCamera | GuiUpdate | GuiButtonHold | CommandTrigger | ScenePointer | SceneNodeClick | UploadStart | UploadPart
)
_DECODER = msgspec.msgpack.Decoder(Said)


class Uploads:
    """How many bytes all pages of a server hold, or have announced, in uploaded files."""

    def __init__(self, most: int = MOST_UPLOADING) -> None:
        """Take how many they may; everything runs on the server's one thread."""
        self._most, self._taken, self._keys = most, {}, itertools.count()

    def take(self, size: int) -> int | None:
        """Set some bytes aside; returns what to ``release``, or None when there are not so many left."""
        if size + sum(self._taken.values()) > self._most:
            return None
        key = next(self._keys)
        self._taken[key] = size
        return key

    def release(self, key: int) -> None:
        """Return the bytes back."""
        self._taken.pop(key, None)

    @property
    def taken(self) -> int:
        """Bytes."""
        return sum(self._taken.values())


class _Transfer(Struct):
    component: str
    size: int
    parts: int
    left: int
    key: int


class Listener:
    """Judges all that one page says."""

    def __init__(self, uploads: Uploads) -> None:
        """Take what all pages share."""
        self._uploads = uploads
        self._transfers: dict[str, _Transfer] = {}
        self._closed = False

    def fault(self, raw: str | bytes) -> str | None:
        """Return what is wrong with a message; None when it is one that a page sends."""
        if not isinstance(raw, bytes):
            return "text, where pages send msgpack"
        try:
            said = _DECODER.decode(raw)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            return str(error)[:200]
        if isinstance(said, UploadStart):
            return self._start(said)
        return self._part(said) if isinstance(said, UploadPart) else None

    def close(self) -> None:
        """The page has gone, and viser has forgotten what it uploaded."""
        self._closed = True
        for transfer in self._transfers.values():
            self._uploads.release(transfer.key)
        self._transfers.clear()

    def _start(self, said: UploadStart) -> str | None:
        if self._closed:  # what was still on its way
            return "an upload of a page that has gone"
        if said.transfer_uuid in self._transfers or (said.part_count == 0) != (said.size_bytes == 0):
            return "an upload that contradicts itself"
        for name, one in list(self._transfers.items()):  # a newer file takes the place of one that is complete
            if one.component == said.source_component_uuid and one.parts == 0:
                self._uploads.release(self._transfers.pop(name).key)
        mine = sum(one.size for one in self._transfers.values())
        if len(self._transfers) >= MOST_TRANSFERS or mine + said.size_bytes > LARGEST_UPLOAD:
            return f"an upload of {said.size_bytes} bytes, more than a page may"
        key = self._uploads.take(said.size_bytes)
        if key is None:
            return f"an upload of {said.size_bytes} bytes, more than there is room for now"
        self._transfers[said.transfer_uuid] = _Transfer(
            said.source_component_uuid, said.size_bytes, said.part_count, said.size_bytes, key
        )
        return None

    def _part(self, said: UploadPart) -> str | None:
        transfer = self._transfers.get(said.transfer_uuid)
        if transfer is None or transfer.parts == 0 or len(said.content) > transfer.left:
            return "a part of no upload that was announced"
        transfer.parts -= 1
        transfer.left -= len(said.content)
        return None
