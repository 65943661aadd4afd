// Constants of the photometric loss, (1 - w) L1 + w (1 - SSIM). SSIM: Wang et al. 2004 with a Gaussian window of 11
// pixels, sigma 1.5, and zero padding.
#pragma once

namespace raster {

enum { RADIUS = 5, TAPS = 2 * RADIUS + 1 };
#define SSIM_C1 1e-4f  // (0.01 * range)^2
// exp(-i^2 / (2 sigma^2)) for offsets 0 to RADIUS, normalised over the window
#define SSIM_WINDOW {0.26601171f, 0.21300554f, 0.10936069f, 0.03600077f, 0.00759876f, 0.00102838f}

// SSIM at a pixel and its derivatives with respect to the windowed x, x^2 and x y, from the windowed x, y, x^2 + y^2, x y
// and the stabiliser of contrast and structure.
struct Similarity {
    Real value, d_mean, d_squares, d_product;
};

RASTER_FN Similarity similarity(Real mx, Real my, Real squares, Real product, float c2) {
    Real a = 2.0f * mx * my + SSIM_C1, b = 2.0f * (product - mx * my) + c2;
    Real c = mx * mx + my * my + SSIM_C1, d = squares - mx * mx - my * my + c2;
    Real inverse = 1.0f / (c * d), inverse_c = inverse * d, inverse_d = inverse * c;
    Similarity s;
    s.value = a * b * inverse;
    s.d_mean = 2.0f * (my * (b - a) * inverse + mx * s.value * (inverse_d - inverse_c));
    s.d_squares = -s.value * inverse_d;
    s.d_product = 2.0f * a * inverse;
    return s;
}

}  // namespace raster
