"""What nodes are forked with (`isogal_ros.graph.forkserver`): their modules, and what numba loads
when the first compiled function is called."""

import gc
import importlib

from isogal.compiled import load_compiler
from isogal_ros.graph.plan import CLASSES

gc.disable()  # nothing of it is garbage; on again in `isogal_ros.nodes.spin.run_node`
for _module, _ in CLASSES.values():
    importlib.import_module(_module)
load_compiler()
gc.freeze()
