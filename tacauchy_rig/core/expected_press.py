"""What a press is expected to give: force against depth of the stated gel, and how sure that is.

The session makes it from the sensor's gel; the protocol, which knows no gel, receives it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedPress:
    """Force against depth of one indenter in one gel; ``expected.json`` of a run.

    Attributes:
        sensor: Whose gel, as its file names it.
        made: How the curve was made, and of what its uncertainty consists, in words.
        depth_m: Rising depths below first touch, from 0 [m].
        force_n: Rising force at each, pressed straight [N].
        low: What the true force may be over the curve's, at least [1].
        high: The same at most [1].
        lean_m: How far one edge of a flat face may come down before its middle, because the face
            leans against the gel [m]; 0 for a ball.
        depth_error_m: How far off the difference of two depths of one press may be [m].
        gel_height_m: Thickness of the gel under the indenter [m].
    """

    sensor: str
    made: str
    depth_m: tuple[float, ...]
    force_n: tuple[float, ...]
    low: float
    high: float
    lean_m: float
    depth_error_m: float
    gel_height_m: float
