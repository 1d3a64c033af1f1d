"""Edit mode and render mode of a scene, and the leases by which the two never meet (specs/26-modes.md).

Pure, but for scene_modes.py, which runs it on a node: the time is an argument, that of this node's own clock, which runs while the
machine sleeps.

    Holder       this node's lease: asked for, granted by a majority, dropped
    Granter      who is granted a lease at a position
    Lender       what clients borrowed of it
    Releases     "I use no lease of a position below this one": this node's word, and that of others
    Activation   from when on a mode that was decided is acted by
    Standing     all of these at one node, as they hang together

`Standing` is immutable: each method is one thing that happened, and answers what is after it.
"""

from scenefold.peer.modes.activation import Activation, Switch
from scenefold.peer.modes.granter import Verdict, verdict
from scenefold.peer.modes.holder import Holder
from scenefold.peer.modes.lender import Borrower, Lender
from scenefold.peer.modes.releases import Releases
from scenefold.peer.modes.scene import DecidedScene
from scenefold.peer.modes.standing import Standing

__all__ = ["Activation", "Borrower", "DecidedScene", "Holder", "Lender", "Releases", "Standing", "Switch", "Verdict", "verdict"]
