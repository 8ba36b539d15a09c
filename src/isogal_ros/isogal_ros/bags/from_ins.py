"""A recording of what an INS has said, and of readings, that were kept as a table."""

from pathlib import Path

import numpy as np

from isogal.inertial.ins_file import InsFile
from isogal.scenario import Scenario
from isogal_ros.bags.writer import BagWriter, scenario_text
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.ins_solution import SolutionMessages
from isogal_ros.messages.stamps import from_seconds

_NO_TURN = np.zeros(3)


def write_ins_bag(
    folder: Path, scenario: Scenario, said: InsFile, value: np.ndarray | None, replace: bool
) -> int:
    """Write a recording with the scenario; return how many messages it has.

    Parameters
    ----------
    folder : Path
    scenario : Scenario
        With `ins.source` solution.
    said : InsFile
    value : (N, 2) array, optional
        What the instrument of the scenario's field sensed, and its 1-sigma (0 = not known), unit
        inside; NaN = nothing at that time.
    replace : bool
        Whether an earlier bag is deleted.

    Raises
    ------
    InputError
        The folder cannot be used.
    """
    writer = BagWriter(folder, {"scenario": scenario_text(scenario), "run": "0"}, replace)
    try:
        messages, adapter = SolutionMessages(scenario), adapter_of(scenario)
        for k, (time, row) in enumerate(zip(said.time.tolist(), said.solution, strict=True)):
            ns = from_seconds(time)
            said_so = messages.of(ns, row, _NO_TURN)
            for topic, message in zip(messages.topics, said_so, strict=True):
                writer.put(topic, message, ns)
            if value is not None and np.isfinite(value[k, 0]):
                reading, sigma = value[k].tolist()
                writer.put(adapter.raw, adapter.write_raw(ns, reading, sigma**2, None), ns)
        return writer.messages
    finally:
        writer.close()
