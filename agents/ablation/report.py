"""The report of an ablation: one HTML page that needs nothing beside it, and results.json with every number."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.ablation.config import AblationConfig, scaled
from agents.ablation.evaluator import Evaluator
from agents.ablation.figures import colours, plot_agreement, plot_curves, plot_measures
from agents.ablation.measure import MEASURES, LibraryFeatures, Measure, measure_run
from agents.ablation.plan import Run
from agents.ablation.statistics import FEWEST, TEXT_MEASURES, Interval, summarise
from agents.training.report import versions
from agents.training.run_folder import RunFolder

TEMPLATE = Path(__file__).with_name("report.html")

_DIVERSITY = Measure(
    "diversity",
    "diversity",
    "",
    2,
    "Mean distance between two episodes of all texts of one seed in the features of the Fréchet distance (Guo et al. 2020); "
    "its interval is over seeds.",
)
_COLUMNS = (*MEASURES, _DIVERSITY)
_TEXT_COLUMNS = tuple(measure for measure in MEASURES if measure.key in TEXT_MEASURES)


def write_report(
    config: AblationConfig,
    runs: Sequence[Run],
    evaluator: Evaluator,
    failed: Sequence[str] = (),
    library: LibraryFeatures | None = None,
) -> Path | None:
    """Measures the finished runs and writes report.html and results.json into the output folder.

    Args:
        config: Options of the ablation.
        runs: All its runs.
        evaluator: What measures CLIP_S.
        failed: One line for each run that failed.
        library: Features of the motion library that motions are compared with; of the project's own if None.

    Returns:
        The page, or None if no run is finished.
    """
    finished = [run for run in runs if run.finished]
    if not finished:
        return None
    library = library or LibraryFeatures()
    values = [measure_run(run, evaluator, library) for run in finished]
    histories = [json.loads(run.folder.report.read_text(encoding="utf-8"))["history"] for run in finished]
    summary = summarise(finished, values, config.rewards)
    results = {
        "config": json.loads(json.dumps(dataclasses.asdict(config), default=str)),
        "trained_as": {reward: scaled(reward) for reward in config.rewards},
        "evaluator": {
            "name": evaluator.name,
            "note": evaluator.note,
            "pictures": evaluator.pictures,
            "independent": evaluator.independent,
        },
        "library_floor": library.floor,
        "summary": summary,
        "runs": [
            {
                "reward": run.reward,
                "text": run.text,
                "seed": run.seed,
                "folder": os.path.relpath(run.folder.path, config.output),
            }
            | {key: value for key, value in each.items() if key != "episode_features"}
            for run, each in zip(finished, values, strict=True)
        ],
        "versions": versions(),
    }
    folder = RunFolder(config.output)
    folder.write_json(config.output / "results.json", results)
    page = config.output / "report.html"
    page.write_text(_page(config, runs, finished, values, histories, results, failed), encoding="utf-8")
    return page


def _page(
    config: AblationConfig,
    runs: Sequence[Run],
    finished: Sequence[Run],
    values: Sequence[dict[str, Any]],
    histories: Sequence[Sequence[dict[str, Any]]],
    results: dict[str, Any],
    failed: Sequence[str],
) -> str:
    import jinja2
    from markupsafe import Markup

    summary = results["summary"]
    palette = colours(config.rewards)
    rows = [
        {
            "reward": reward,
            "trained_as": scaled(reward),
            "colour": palette[reward],
            "runs": summary["rewards"][reward]["runs"],
            "cells": [
                _cell(
                    measure,
                    summary["rewards"][reward][measure.key],
                    summary["differences"].get(reward, {}).get(measure.key),
                )
                for measure in _COLUMNS
            ],
        }
        for reward in config.rewards
    ]
    text_rows = [
        {"text": text, "cells": [_text_cell(by_reward[reward]) for reward in config.rewards]}
        for text, by_reward in summary["texts"].items()
    ]
    run_rows = [
        {
            "name": run.name,
            "link": Path(os.path.relpath(run.folder.path, config.output)).as_posix() + "/",
            "decisions": f"{each['decisions']:,}",
            "cells": [measure.show(_number(each[measure.key])) for measure in MEASURES],
        }
        for run, each in zip(finished, values, strict=True)
    ]
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    return template.render(
        finished=len(finished),
        planned=len(runs),
        rewards=config.rewards,
        texts=config.texts,
        seeds=config.seeds,
        minutes=config.minutes,
        evaluator_note=results["evaluator"]["note"],
        own_judge=not results["evaluator"]["independent"],
        failed=failed,
        fewest=FEWEST,
        heads=[dataclasses.asdict(measure) | {"per_run": measure in MEASURES} for measure in _COLUMNS],
        rows=rows,
        floor=f"{results['library_floor']:.1f}",
        measures_figure=Markup(plot_measures(finished, values, config.rewards, summary)),
        curves_figure=Markup(plot_curves(finished, histories, config.rewards)),
        text_rows=text_rows,
        text_measures=", ".join(measure.label for measure in _TEXT_COLUMNS),
        agreement=_agreement(summary["agreement"]),
        agreement_figure=Markup(plot_agreement(finished, values, config.rewards)),
        run_rows=run_rows,
        versions=", ".join(f"{name} {version}" for name, version in results["versions"].items()),
    )


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _cell(measure: Measure, value: Interval | None, difference: Interval | None) -> dict[str, str]:
    """A cell of the table: mean, interval, and whether it is better or worse than that of the first reward.

    For too few runs to have an interval, the lowest and the highest value take its place.
    """
    if value is None:
        return {"mean": "–", "range": "", "verdict": ""}
    assert value["mean"] is not None
    low, high = value["low"], value["high"]
    if low is not None and high is not None:
        shown = f"{measure.show(low)} to {measure.show(high)}"
    else:
        shown = "" if value["count"] == 1 else f"seen: {_span(measure, value)}"
    return {"mean": measure.show(value["mean"]), "range": shown, "verdict": _verdict(measure, difference)}


def _span(measure: Measure, value: Interval) -> str:
    """The lowest and the highest of some runs; one number if they look alike."""
    ends = [measure.show(_number(value[end])) for end in ("least", "most")]
    return " to ".join(dict.fromkeys(ends))


def _verdict(measure: Measure, difference: Interval | None) -> str:
    if difference is None or not measure.better or difference["low"] is None or difference["high"] is None:
        return ""
    if difference["low"] <= 0 <= difference["high"]:
        return ""
    return "better" if (difference["low"] > 0) == (measure.better == "higher") else "worse"


def _text_cell(values: dict[str, Interval | None]) -> dict[str, str]:
    """Means of the seeds, and below them the lowest and the highest."""
    if values["clip_s"] is None:
        return {"mean": "–", "range": ""}
    cells = [(measure, values[measure.key]) for measure in _TEXT_COLUMNS]
    means = [measure.show(_number(each["mean"])) if each else "no check" for measure, each in cells]
    spans = [_span(measure, each) for measure, each in cells if each and each["count"] != 1]
    return {"mean": ", ".join(means), "range": ", ".join(spans)}


def _agreement(found: Interval | None) -> str:
    if found is None:
        return f"No rank correlation can be given: it needs at least {FEWEST} runs of texts with a check, and that they differ."
    return (
        f"Spearman's rank correlation of CLIP_S and success over {found['count']} runs is {found['mean']:.2f} "
        f"(95 % interval {found['low']:.2f} to {found['high']:.2f}). Each mark is a run. Texts are mixed, and some have a "
        "higher CLIP_S than others whatever is done: look at the texts apart before trusting it."
    )
