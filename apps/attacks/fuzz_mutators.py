"""Makes damaged and hostile files out of valid ones; every choice comes from one source of random numbers."""

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from copy import deepcopy
from random import Random
from typing import Any

import numpy as np

Bytes = Callable[[Random, bytes], bytes]
INTS = (0, 1, 2, 3, 7, 127, 128, 255, 256, 32767, 32768, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1,
        2**64 - 1, -1, -2, -128, -(2**31), -(2**63))  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 0.5, -0.0, 1e-320, 1e9, -1e9, 1e300, 1e308, float("nan"), float("inf"),
    -float("inf"), 10**20, 10**400, 65535, 65536, 2**31, "", " ", "x", "none", "chair", "floor", "\ud800", "a\nb",
    "\x00", "\u2028", "..", "../..", "/etc/passwd", "../../../etc/passwd", "{frame}", "{frame}{frame}{0}", "%s%n",
    "x" * 3000, [], {}, [[]], [{}], {"": ""}, [0, 0, 0], [0, 0, 1], [1e200, 0, 0], [1, 2, 3, 4], [None] * 3, "NaN",
)  # fmt: skip
WORDS = ("nan", "inf", "-inf", "1e999", "-1e308", "1e308", "1e-320", "0", "-0", "1", "-1", "0x10", "٣", "9" * 400,
         "1_000", "\x00", "..", "../x", "/etc/passwd", "../../../etc/passwd", "name", "#", "\u2028", "\ufeff", "é" * 90,
         "1e9", "-1e9", "12345678.9", "\x85", "1e3", "0.001", "x" * 5000, "", ",", ":", "\r", "\x1b[31m")  # fmt: skip
DEEP = 3000
SHAPES = (
    "()", "(-1,)", "(1,)", f"({10**9}, {10**9})", "(3, 0)", "(2**62,)", f"({2**63},)", "(1,) * 9", "(60, 60)",
    "(48, 64, 1)", "((((1,),),),)", "(" * 90 + "1" + ")" * 90, "'a'", "None",
)  # fmt: skip
KINDS = (
    "'|O'", "'<f8'", "'>i8'", "'<U9'", "'|S1'", "'<c16'", "[('a', '<f4')]", "'<M8[s]'", "'|V0'", "'<U999999999'",
    "'|b1'", "{}", "'<f2'", "'|u1'",
)  # fmt: skip
"""Of arrays, as their headers say it."""


def mutate_bytes(r: Random, data: bytes) -> bytes:
    """Change a few bytes: bits, numbers, missing, doubled and made-up pieces."""
    out = bytearray(data)
    for _ in range(r.randint(1, 4)):
        at = r.randrange(len(out) + 1)
        kind = r.randrange(9)
        if kind == 0 and out:
            out[at % len(out)] ^= 1 << r.randrange(8)
        elif kind == 1 and out:
            out[at % len(out)] = r.randrange(256)
        elif kind in (2, 3):
            size = r.choice((1, 2, 4, 8))
            number = (r.choice(INTS) % (1 << 8 * size)).to_bytes(size, r.choice(("little", "big")))
            out[at : at + size] = number[: max(len(out) - at, 0)] or number
        elif kind == 4:
            del out[at : at + r.choice((1, 2, 4, 16, 256))]
        elif kind == 5:
            out[at:at] = out[at : at + r.choice((1, 4, 64))] * r.choice((1, 2, 50))
        elif kind == 6:
            out[at:at] = r.randbytes(r.randrange(1, 9))
        elif kind == 7:
            del out[at if r.random() < 0.5 else len(out) - min(len(out), 1 + at % 32) :]
        else:
            end = min(at + r.randrange(1, 64), len(out))
            out[at:end] = bytes([r.choice((0, 255, 32))]) * (end - at)
    return bytes(out)


def mutate_value(r: Random, value: Any) -> Any:
    """Change one thing somewhere in a tree of JSON values; the tree itself is changed."""
    parents: list[tuple[Any, Any]] = []
    here = value
    while isinstance(here, dict | list) and here and (not parents or r.random() < 0.75):
        key = r.choice(list(here)) if isinstance(here, dict) else r.randrange(len(here))
        parents.append((here, key))
        here = here[key]
    if not parents:
        return deepcopy(r.choice(VALUES))
    holder, key = parents[-1]
    kind = r.randrange(8)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder, dict):
        holder[r.choice((str(key) + "s", str(key)[:-1], "x", "", "\ud800"))] = holder.pop(key)
    elif kind == 1 or (kind == 2 and isinstance(holder, list)):
        holder.insert(r.randrange(len(holder) + 1), deepcopy(holder[key]))
    elif kind == 3 and isinstance(here, int | float) and abs(here) < 1e300:
        holder[key] = r.choice((-here, here + 1, here - 1, here * 1e9, here * 1e-9, here / 3, int(here)))
    elif kind == 4 and isinstance(here, str):
        holder[key] = _changed_word(r, here)
    else:
        holder[key] = deepcopy(r.choice(VALUES))
    return value


def mutate_json(r: Random, data: bytes) -> bytes:
    """Change values, keys or, now and then, the text of a JSON file."""
    if r.random() < 0.15:
        return mutate_bytes(r, data)
    value = json.loads(data)
    for _ in range(r.choice((1, 1, 1, 2, 4))):
        value = mutate_value(r, value)
    text = json.dumps(value, ensure_ascii=r.random() < 0.8)
    kind = r.random()
    if kind < 0.03:
        text = text.replace("{", '{"x": ' + r.choice(("[", '{"a":')) * r.choice((10, DEEP, 200_000)), 1)
    elif kind < 0.06:
        text = text.replace(",", ", " + text.partition(",")[0].lstrip("{[") + ",", 1)  # the first key twice
    return text.encode("utf-8", "surrogatepass")


def mutate_text(r: Random, data: bytes) -> bytes:
    """Change words and lines of a text file."""
    if r.random() < 0.15:
        return mutate_bytes(r, data)
    lines = data.decode("utf-8", "replace").split("\n")
    for _ in range(r.choice((1, 1, 2, 4))):
        at = r.randrange(len(lines))
        kind = r.randrange(7)
        words = lines[at].split(" ")
        if kind == 0 and len(lines) > 1:
            del lines[at]
        elif kind == 1:
            lines.insert(r.randrange(len(lines) + 1), lines[at])
        elif kind == 2:
            lines[at] = r.choice(WORDS)
        elif kind == 3:
            del words[r.randrange(len(words))]
            lines[at] = " ".join(words)
        elif kind == 4:
            words.insert(r.randrange(len(words) + 1), r.choice(WORDS))
            lines[at] = " ".join(words)
        else:
            which = r.randrange(len(words))
            words[which] = r.choice(WORDS) if kind == 5 else _changed_word(r, words[which])
            lines[at] = " ".join(words)
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def _changed_word(r: Random, word: str) -> str:
    at = r.randrange(len(word) + 1)
    return r.choice((word[:at], word[at:], word + word, word[:at] + "\x00" + word[at:], "-" + word, word + "0" * 12,
                     word[:at] + "." + word[at:], word[:at] + "e9" + word[at:], word.upper(), word[::-1]))  # fmt: skip


def mutate_png(r: Random, data: bytes) -> bytes:
    """Change the header, chunks or pixels of a PNG and make its checksums right again."""
    if r.random() < 0.25 or not data.startswith(b"\x89PNG"):
        return mutate_bytes(r, data)
    chunks, at = [], 8
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        chunks.append([data[at + 4 : at + 8], data[at + 8 : at + 8 + size]])
        at += 12 + size
    chunk = r.choice(chunks)
    kind = r.randrange(6)
    if kind <= 1:
        head = bytearray(chunks[0][1])
        field = r.randrange(7)
        if field < 2:
            struct.pack_into(">I", head, 4 * field, r.choice(INTS) % (1 << 32))
        else:
            head[6 + field] = r.choice((0, 1, 2, 3, 4, 6, 8, 16, 32, 255))
        chunks[0][1] = bytes(head)
    elif kind == 2:
        chunks.remove(chunk)
    elif kind == 3:
        chunks.insert(r.randrange(len(chunks) + 1), [r.choice((b"tRNS", b"PLTE", b"acTL", b"iCCP", b"zTXt", b"eXIf")),
                                                     zlib.compress(bytes(r.choice((0, 10, 10**6))))])  # fmt: skip
    elif kind == 4 and chunk[0] == b"IDAT":
        chunk[1] = zlib.compress(mutate_bytes(r, bytes(r.choice((0, 100, 5000)))))
    else:
        chunk[1] = mutate_bytes(r, chunk[1])
    whole = [struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in chunks]
    return data[:8] + b"".join(whole)


def mutate_jpeg(r: Random, data: bytes) -> bytes:
    """Change the sizes, a segment or any bytes of a JPEG."""
    start = data.find(b"\xff\xc0")
    if r.random() < 0.4 and start > 0:
        out = bytearray(data)
        struct.pack_into(">H", out, start + r.choice((2, 5, 7)), r.choice(INTS) % 65536)
        return bytes(out)
    end = max(data.find(b"\xff\xda"), 20)
    return mutate_bytes(r, data[:end]) + data[end:] if r.random() < 0.5 else mutate_bytes(r, data)


def mutate_npy(r: Random, data: bytes) -> bytes:
    """Change the header or the numbers of a NumPy file."""
    if r.random() < 0.3 or len(data) < 12:
        return mutate_bytes(r, data)
    start = 10 + int.from_bytes(data[8:10], "little")
    head, rest = data[10:start].decode("latin-1"), data[start:]
    kind = r.randrange(5)
    if kind == 0:
        shape = r.choice(SHAPES)
        head = head.partition("'shape':")[0] + f"'shape': {shape}, }}"
    elif kind == 1:
        old = head.partition("'descr': ")[2].partition(",")[0]
        head = head.replace(old, r.choice(KINDS))
    elif kind == 2:
        head = mutate_text(r, head.encode()).decode("latin-1")
    elif kind == 3:
        rest = mutate_bytes(r, rest)
    else:
        head = head.replace("False", "True")
    words = head.strip().encode("latin-1", "replace")[:60000] + b"\n"
    return data[:8] + len(words).to_bytes(2, "little") + words + rest


def mutate_zip(r: Random, data: bytes, member: Callable[[str], Bytes]) -> bytes:
    """Change a file in an archive, the list of files, or the archive's own bytes."""
    if r.random() < 0.25:
        return mutate_bytes(r, data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    name = r.choice(list(files))
    kind = r.randrange(6)
    if kind == 0:
        del files[name]
    elif kind == 1:
        files[r.choice((name + "x", "../" + name, "/" + name, "x" * 300, "rgbd/x.jpg", "rgbd/²"))] = files.pop(name)
    else:
        files[name] = member(name)(r, files[name])
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", r.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for key, content in files.items():
            archive.writestr(zipfile.ZipInfo(key), content)
    whole = out.getvalue()
    return mutate_bytes(r, whole) if kind == 5 else whole


def mutate_array(r: Random, array: np.ndarray) -> np.ndarray:
    """Change some numbers, the shape or the type of an array, or the JSON in one of text."""
    if array.dtype.kind == "U":
        return np.array(mutate_json(r, str(array).encode()).decode("utf-8", "replace"))
    kind = r.randrange(6)
    if kind <= 2 and array.size:
        array = array.copy()
        flat = array.reshape(-1)
        for _ in range(r.choice((1, 1, 3))):
            at = r.randrange(array.size)
            if array.dtype.kind == "f":
                flat[at] = r.choice((np.nan, np.inf, -np.inf, 0, -1, 1e30, 1e-30))
            else:
                low, high = (int(x) for x in (np.iinfo(array.dtype).min, np.iinfo(array.dtype).max))
                more = int(flat[at]) + 1 if flat[at] < high else 0
                flat[at] = r.choice((low, high, 0, 1, -1 if low else high, more, flat[r.randrange(array.size)]))
        return array
    if kind == 3:
        return array[: len(array) // 2] if array.ndim else array
    if kind == 4:
        return np.concatenate([array, array]) if array.ndim else array
    return array.astype(r.choice((np.int16, np.int32, np.float32, np.float64, np.uint8, np.int64)))


def mutator_of(name: str) -> Bytes:
    """Return the way to damage a file of that name."""
    suffix = name.rpartition(".")[2].lower()
    if suffix == "json" or name.endswith("metadata"):
        return mutate_json
    if suffix in ("txt", "traj", "pincam", "yaml"):
        return mutate_text
    if suffix == "r3d":
        return lambda r, data: mutate_zip(r, data, mutator_of)
    return {"png": mutate_png, "jpg": mutate_jpeg, "npy": mutate_npy}.get(suffix, mutate_bytes)
