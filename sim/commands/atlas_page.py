"""Markdown pages of the atlas, from the effect table and the figures of one drawing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from starling.sim.effects import Effect, Parameter, Stage, Value, written

_STAGES = {
    Stage.SCENE: "Scene",
    Stage.LIGHT: "Projector",
    Stage.OPTICS: "Optics",
    Stage.IMAGER: "Imager",
    Stage.MATCHER: "Matcher",
    Stage.POST: "Post-processing",
}

# Short names of figures; the index defines them.
_LABELS = {
    "mean level [share of full scale]": "mean level",
    "disparity bias [px]": "bias [px]",
    "disparity NMAD [px]": "NMAD [px]",
    "off by more than 1 px [%]": "over 1 px [%]",
}


def index(rows: Sequence[Effect]) -> str:
    """Write the index page, which lists all effects by stage."""
    lines = [
        "# Effect atlas",
        "",
        "Every effect of the table (`starling effects`), drawn on the `tabletop` scene by",
        "`starling atlas`. A picture shows infrared, disparity error and holes: without the effect",
        "on the left, with it on the right. The mean level is a share of full scale. Bias, NMAD",
        "and pixels over 1 px are of the disparity error. A page states where a new value needs a",
        "new render. In brackets: the family, where its name differs. Effects of one family share",
        "a physical cause.",
    ]
    for stage, title in _STAGES.items():
        listed = [row for row in rows if row.stage is stage]
        if listed:
            lines += ["", f"## {title}", "", *map(_entry, listed)]
    return "\n".join(lines) + "\n"


def text(row: Effect) -> str:
    """Write one effect's row of the table as Markdown."""
    confusable = ", ".join(f"[{_words(name)}]({name}.md)" for name in row.confused_with)
    return "\n".join(
        [
            f"# {_words(row.name).capitalize()}",
            "",
            f"{row.imitates}",
            "",
            f"![without, with]({row.name}.jpg)",
            "",
            f"**Image.** {row.shows}",
            "",
            f"**Confused with.** {confusable or 'nothing'}.",
            "",
            f"**Law.** {row.law}",
            "",
            f"**Source.** {row.source}",
            "",
            *([f"**New render.** {row.rerender}.", ""] if row.rerender else []),
            "| parameter | moves | neutral | range | unit |",
            "| --- | --- | --- | --- | --- |",
            *(_parameter(parameter) for parameter in row.parameters),
            "",
        ]
    )


def page(row: Effect, value: Value, figures: Mapping[str, Mapping[str, float]]) -> str:
    """Write one effect's page: the table's text and the figures of the picture.

    Args:
        row: row of the effect table.
        value: drawn value of its first parameter.
        figures: `{"without": {NAME: number}, "with": {NAME: number}}`.
    """
    lines = [
        f"Measured on the picture, {row.parameters[0].name} = {written(value)}:",
        "",
        "| | without | with |",
        "| --- | --- | --- |",
        *(
            f"| {_LABELS.get(name, name)} | {without:.3g} | {figures['with'][name]:.3g} |"
            for name, without in figures["without"].items()
        ),
    ]
    return text(row) + "\n" + "\n".join(lines) + "\n"


def _entry(row: Effect) -> str:
    family = "" if row.family == row.name else f" ({_words(row.family)})"
    return f"- [{_words(row.name)}]({row.name}.md){family}"


def _parameter(parameter: Parameter) -> str:
    moves = ", ".join(f"`{path}`" for path in parameter.paths)
    neutral = "as the sensor" if parameter.neutral is None else written(parameter.neutral)
    if parameter.choices:
        span = ", ".join(map(written, parameter.choices))
    else:
        span = f"{parameter.low:g} to {parameter.high:g}"
    return f"| {parameter.name} | {moves} | {neutral} | {span} | {parameter.unit} |"


def _words(name: str) -> str:
    return name.replace("_", " ")
