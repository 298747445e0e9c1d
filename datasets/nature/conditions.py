"""What nature, camera and files do to made photographs, by name."""

from dataclasses import dataclass
from typing import Literal

Name = Literal[
    "plain", "ideal", "bits_8", "noise_1", "noise_3", "jpeg_95", "jpeg_90", "jpeg_75", "fish", "fish_2", "snow",
    "caustics_10", "caustics_25", "exposure_5", "exposure_15", "exposure_30", "auto_exposure", "white_balance_3",
    "white_balance_10", "auto_white_balance", "tone", "camera", "linear_light", "vignette_15", "vignette_35", "strobe",
    "strobe_narrow", "strobe_daylight", "strobe_auto_exposure", "pose_1", "pose_2", "depth_1", "depth_3",
    "depth_scale_1", "depth_scale_3", "patchy_water", "scatter", "scatter_weak", "clipping", "dark",
    "low_contrast", "air", "all_mild",
]  # fmt: skip


@dataclass(frozen=True)
class Condition:
    """Shares are of 1; a jitter is a standard deviation over the views."""

    noise: float = 0.004
    """Standard deviation, of a stored intensity."""

    bits: bool = True
    """Whether files have 8 bits."""

    jpeg: int = 0
    """Quality, with colours at half size; 0: no JPEG."""

    gain: float = 1
    """Of all views."""

    exposure: float = 0
    """Jitter."""

    auto_exposure: bool = False

    white_balance: float = 0
    """Jitter of each channel."""

    auto_white_balance: float = 0
    """Exponent of gray world's gains in each view."""

    tone: Literal["", "s", "srgb"] = ""
    """Empty: none; "s": S-curve; "srgb": linear light stored as sRGB."""

    vignette: float = 0
    """Loss in the farthest corner."""

    strobe_deg: float = 0
    """Width of the lobe; 0: no strobe."""

    daylight: float = 1
    """Beside a strobe."""

    fish: int = 0
    """Number of views with fish."""

    snow: float = 0
    """Share of pixels."""

    caustics: float = 0
    """Standard deviation of the light on the ground."""

    pose_px: float = 0
    """Root mean square of the pixels' shift by a drift of the poses."""

    depth_patches: float = 0
    """Standard deviation of the relative error, in patches of a tenth of the width."""

    depth_scale: float = 0
    """Jitter of the scale of a view's depth map."""

    patchy: float = 0
    """Jitter of beta and gamma."""

    blur_px_m: float = 0
    """Forward scatter: standard deviation, pixels a metre."""

    contrast: float = 1
    """Of the ground's colours."""

    air: bool = False


CONDITIONS: dict[Name, Condition] = {
    "plain": Condition(),
    "ideal": Condition(noise=0, bits=False),
    "bits_8": Condition(noise=0),
    "noise_1": Condition(noise=0.01),
    "noise_3": Condition(noise=0.03),
    "jpeg_95": Condition(jpeg=95),
    "jpeg_90": Condition(jpeg=90),
    "jpeg_75": Condition(jpeg=75),
    "fish": Condition(fish=1),
    "fish_2": Condition(fish=2),
    "snow": Condition(snow=0.005),
    "caustics_10": Condition(caustics=0.10),
    "caustics_25": Condition(caustics=0.25),
    "exposure_5": Condition(exposure=0.05),
    "exposure_15": Condition(exposure=0.15),
    "exposure_30": Condition(exposure=0.30),
    "auto_exposure": Condition(auto_exposure=True),
    "white_balance_3": Condition(white_balance=0.03),
    "white_balance_10": Condition(white_balance=0.10),
    "auto_white_balance": Condition(auto_white_balance=0.5),
    "tone": Condition(tone="s"),
    "camera": Condition(auto_exposure=True, auto_white_balance=0.5, tone="s", jpeg=92),
    "linear_light": Condition(tone="srgb"),
    "vignette_15": Condition(vignette=0.15),
    "vignette_35": Condition(vignette=0.35),
    "strobe": Condition(strobe_deg=35, daylight=0),
    "strobe_narrow": Condition(strobe_deg=20, daylight=0),
    "strobe_daylight": Condition(strobe_deg=35, daylight=0.3),
    "strobe_auto_exposure": Condition(strobe_deg=35, daylight=0, auto_exposure=True),
    "pose_1": Condition(pose_px=1),
    "pose_2": Condition(pose_px=2),
    "depth_1": Condition(depth_patches=0.01),
    "depth_3": Condition(depth_patches=0.03),
    "depth_scale_1": Condition(depth_scale=0.01),
    "depth_scale_3": Condition(depth_scale=0.03),
    "patchy_water": Condition(patchy=0.1),
    "scatter": Condition(blur_px_m=0.5),
    "scatter_weak": Condition(blur_px_m=0.2),
    "clipping": Condition(gain=2),
    "dark": Condition(gain=0.15, noise=0.006),
    "low_contrast": Condition(contrast=0.2),
    "air": Condition(air=True),
    "all_mild": Condition(
        pose_px=0.5,
        depth_patches=0.005,
        exposure=0.03,
        vignette=0.05,
        caustics=0.03,
        fish=1,
        snow=0.001,
        jpeg=92,
    ),
}
