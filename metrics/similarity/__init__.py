"""Similarity to a reference image: PSNR and SSIM."""

from sucre_bench.metrics.similarity.psnr_and_ssim import Psnr, Ssim

__all__ = ["Psnr", "Ssim"]
