"""Selection of scenes with equal contents: a pipeline segment is evaluated on all its scenes."""

from __future__ import annotations

from collections.abc import Sequence

from starling.diagnosis.scenes.scene_model import SceneModel

Contents = tuple[bool, bool]  # Infrared pairs, device depth.


def split_complete(
    scene_models: Sequence[SceneModel],
) -> tuple[list[SceneModel], list[SceneModel]]:
    """Separate scenes that hold all that most scenes hold from incomplete ones.

    A single incomplete scene would otherwise exclude a segment for all scenes. In a tie the
    contents with infrared count as the most frequent.

    Args:
        scene_models: at least one.

    Returns:
        Complete scenes and incomplete scenes.
    """
    contents = [_contents(scene) for scene in scene_models]
    required = max(set(contents), key=lambda kind: (contents.count(kind), kind))
    complete = [
        all(has >= must for has, must in zip(kind, required, strict=True)) for kind in contents
    ]
    return (
        [scene for scene, holds in zip(scene_models, complete, strict=True) if holds],
        [scene for scene, holds in zip(scene_models, complete, strict=True) if not holds],
    )


def _contents(scene: SceneModel) -> Contents:
    return scene.real.left is not None, scene.real.device_px is not None
