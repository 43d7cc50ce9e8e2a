"""A map whose every text is an attack on whoever shows it."""

import dataclasses

from toy_maps import toy_map

from simaps_viz.structures import SIMap

SCRIPT = "</script><script>window.pwned=1</script>"
IMAGE = '<img src=x onerror="window.pwned=1">'
TEXTS = (IMAGE, SCRIPT, f'"><svg onload=window.pwned=1>{IMAGE}', "[a](javascript:window.pwned=1)", "';window.pwned=1;'",
         "{{constructor.constructor('window.pwned=1')()}}", "<iframe src=http://evil.example></iframe>")  # fmt: skip

PWNED = "() => window.pwned === 1 || document.querySelector('img[src=x], svg[onload], iframe[src*=evil]') !== null"


def hostile_map() -> SIMap:
    """Objects, frames, sequence and source, all named to run a script."""
    simap = toy_map()
    new: dict[str, str] = dict(zip(("chair", "couch", "dining table", "potted plant", "tv"), TEXTS, strict=False))
    grid = dataclasses.replace(simap.grid, labels=tuple(new.get(label, label) for label in simap.grid.labels))
    instances = tuple(dataclasses.replace(one, label=new.get(one.label, one.label)) for one in simap.instances)
    names = tuple(f"{n} {TEXTS[n % len(TEXTS)]}" for n in range(len(simap.frame_names)))
    told = {"name": IMAGE + SCRIPT, "segmentation": IMAGE, "sequence": SCRIPT, "simulated": True}
    provenance = {**simap.provenance, **told}
    return dataclasses.replace(simap, grid=grid, instances=instances, frame_names=names, provenance=provenance)
