"""The published architectures. This module imports torch; only `run_torch` imports it, when a network is needed.

Written from the papers; attributes are named so that the keys of the public checkpoints fit. All are fully
convolutional: (N, C, H, W) -> (N, 3, H, W).
"""

from collections import OrderedDict

import torch
from torch import nn


class WaterNet(nn.Module):
    """Gated fusion (Li et al. 2020, sec. V): the sum of three refined images, each times its confidence map.

    In: 12 channels in [0, 1], the image, then white-balanced, equalised, gamma-corrected. Out: not negative, may
    exceed 1. 1,090,668 parameters.
    """

    def __init__(self) -> None:
        super().__init__()
        maps = [(128, 7), (128, 5), (128, 3), (64, 1), (64, 7), (64, 5), (64, 3), (3, 3)]
        refine = [(32, 7), (32, 5), (3, 3)]
        self.cmg = _convolutions(12, maps, nn.Sigmoid())
        self.wb_refiner, self.ce_refiner, self.gc_refiner = (
            _convolutions(6, refine, nn.ReLU()) for _ in range(3)
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        raw, *derived = x.split(3, dim=1)
        refiners = (self.wb_refiner, self.ce_refiner, self.gc_refiner)
        confidence = self.cmg(x).split(1, dim=1)
        refined = (
            of(torch.cat([raw, image], dim=1))
            for of, image in zip(refiners, derived, strict=True)
        )
        return torch.stack(
            [c * image for c, image in zip(confidence, refined, strict=True)]
        ).sum(dim=0)


def _convolutions(
    channels: int, layers: list[tuple[int, int]], last: nn.Module
) -> nn.Sequential:
    """Convolutions (features, size of the kernel) that keep the size, ReLU between, `last` at the end."""
    parts: OrderedDict[str, nn.Module] = OrderedDict()
    for i, (features, size) in enumerate(layers, start=1):
        parts[f"conv{i}"] = nn.Conv2d(channels, features, size, padding=size // 2)
        parts[f"act{i}"] = nn.ReLU() if i < len(layers) else last
        channels = features
    return nn.Sequential(parts)


class FunieGenerator(nn.Module):
    """U-Net of five steps down and five up (Islam et al. 2020, fig. 3). In and out: 3 channels in [-1, 1].

    Height and width are multiples of 32. 7,019,587 parameters.
    """

    def __init__(self) -> None:
        super().__init__()
        self.down1 = _down(3, 32, normalised=False)
        self.down2 = _down(32, 128)
        self.down3 = _down(128, 256)
        self.down4 = _down(256, 256)
        self.down5 = _down(256, 256, normalised=False)
        self.up1 = _up(256, 256)
        self.up2 = _up(512, 256)
        self.up3 = _up(512, 128)
        self.up4 = _up(256, 32)
        # A kernel of 4 has no middle: one more row and column above and to the left keep the size.
        self.final = nn.Sequential(
            nn.Upsample(scale_factor=2),
            nn.ZeroPad2d((2, 1, 2, 1)),
            nn.Conv2d(64, 3, 4),
            nn.Tanh(),
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        seen = []
        for down in (self.down1, self.down2, self.down3, self.down4):
            x = down(x)
            seen.append(x)
        x = self.down5(x)
        for up in (self.up1, self.up2, self.up3, self.up4):
            x = torch.cat([up(x), seen.pop()], dim=1)
        return self.final(x)


def _down(channels: int, features: int, normalised: bool = True) -> nn.Module:
    norm = [nn.BatchNorm2d(features)] if normalised else []
    layers = [
        nn.Conv2d(channels, features, 4, stride=2, padding=1, bias=False),
        *norm,
        nn.LeakyReLU(0.2),
    ]
    return nn.Sequential(OrderedDict(model=nn.Sequential(*layers)))


def _up(channels: int, features: int) -> nn.Module:
    layer = nn.ConvTranspose2d(channels, features, 4, stride=2, padding=1, bias=False)
    return nn.Sequential(
        OrderedDict(model=nn.Sequential(layer, nn.BatchNorm2d(features), nn.ReLU()))
    )


class TaclGenerator(nn.Module):
    """The forward generator of Liu et al. 2022: a residual network of nine blocks (Johnson et al. 2016).

    In and out: 3 channels in [-1, 1]; height and width are multiples of 4, 8 at least. Instance normalisation makes
    each pixel depend on the whole image. 11,378,179 parameters.
    """

    def __init__(self) -> None:
        super().__init__()
        self.model = nn.Sequential(
            nn.ReflectionPad2d(3),
            *_normalised(nn.Conv2d(3, 64, 7)),
            *_normalised(nn.Conv2d(64, 128, 3, stride=2, padding=1)),
            *_normalised(nn.Conv2d(128, 256, 3, stride=2, padding=1)),
            *(_Residual(256) for _ in range(9)),
            *_normalised(
                nn.ConvTranspose2d(256, 128, 3, stride=2, padding=1, output_padding=1)
            ),
            *_normalised(nn.ConvTranspose2d(128, 64, 3, stride=2, padding=1, output_padding=1)),
            nn.ReflectionPad2d(3),
            nn.Conv2d(64, 3, 7),
            nn.Tanh(),
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.model(x)


class _Residual(nn.Module):
    def __init__(self, features: int) -> None:
        super().__init__()
        first, second = (nn.Conv2d(features, features, 3) for _ in range(2))
        self.conv_block = nn.Sequential(
            nn.ReflectionPad2d(1),
            *_normalised(first),
            nn.ReflectionPad2d(1),
            *_normalised(second)[:2],
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.conv_block(x)


def _normalised(layer: nn.Conv2d | nn.ConvTranspose2d) -> list[nn.Module]:
    return [layer, nn.InstanceNorm2d(layer.out_channels), nn.ReLU()]
