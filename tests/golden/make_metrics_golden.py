#!/usr/bin/env python3
"""Golden numbers for tests/unit/test_metrics.c, from scikit-image and NumPy.

    pip install numpy scikit-image
    python3 tests/golden/make_metrics_golden.py > tests/golden/metrics.txt
"""
import numpy as np
import skimage
from skimage.metrics import structural_similarity

print(f"# scikit-image {skimage.__version__}, NumPy {np.__version__}; made by tests/golden/make_metrics_golden.py")
print("# channels rows cols mse mae psnr ssim sharpness authors_psnr authors_ssim")
for channels, rows, cols in [(1, 11, 11), (1, 32, 48), (3, 40, 33), (3, 96, 64)]:
    c, r, k = np.meshgrid(np.arange(channels), np.arange(rows), np.arange(cols), indexing="ij")
    a = ((r * 37 + k * 91 + c * 53 + (r * k) % 17 * 5) % 256 / 256.0).astype(np.float32)
    b = (0.75 * a.astype(np.float64) + ((r * 13 + k * 7 + c * 29) % 64) / 512.0).astype(np.float32)
    a, b = a.astype(np.float64), b.astype(np.float64)
    mse = np.mean((a - b) ** 2)
    ssim, authors_ssim = (structural_similarity(a, b, data_range=span, gaussian_weights=True, sigma=1.5,
                                                use_sample_covariance=False, channel_axis=0) for span in (1.0, 2.0))
    with np.errstate(divide="ignore"):  # infinite where a pixel is exact
        authors_psnr = np.mean(10 * np.log(1 / np.mean((a - b) ** 2, axis=0)) / 2.303)
    sharpness = np.mean([np.hypot(*np.gradient(plane)) for plane in a])
    print(channels, rows, cols, *(f"{v:.12g}" for v in
          (mse, np.mean(np.abs(a - b)), -10 * np.log10(mse), ssim, sharpness, authors_psnr, authors_ssim)))
