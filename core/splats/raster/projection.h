// World to screen for `LANES` Gaussians at a time, and back for their gradients (EWA splatting: Zwicker et al. 2001,
// in the form of Kerbl et al. 2023).
#pragma once

namespace raster {

// RASTER_LOW_PASS, defined by state.py: square pixels added to the screen covariance.

// As `RasterCamera.packed` in frame.py orders it.
struct Camera {
    float rotation[9], translation[3];       // world to camera, row-major
    float center[3];                         // of the camera, in the world
    float fx, fy, cx, cy;                    // pixels
    float near;                              // smallest depth drawn, scene units
    float x_low, x_high, y_low, y_high;      // bounds of x / z and y / z within which the perspective is linearised
    float background[3];
};

// A Gaussian on the screen: what the tiles read. opacity * 2^(xx dx^2 + xy dx dy + yy dy^2) is its alpha at an offset.
struct Splat {
    float x, y;          // pixels
    float xx, xy, yy;    // exponent of two, per square pixel
    float opacity;
    float color[3];
    float depth;
    float cutoff;        // the exponent at which alpha is RASTER_ALPHA_MIN; negative
    float extent_x, extent_y;  // half the size of the box in which alpha reaches it; negative where nothing is drawn
    float radius;        // pixels; three standard deviations along the major axis
    float pad[2];
};

// Real spherical harmonics in the order and with the signs of the standard 3DGS PLY, degree <= 3.
RASTER_FN void harmonics(int count, Real x, Real y, Real z, Real* basis) {
    basis[0] = splat(0.28209479177387814f);
    if (count < 4) return;
    const float c1 = 0.4886025119029199f;
    basis[1] = -c1 * y;
    basis[2] = c1 * z;
    basis[3] = -c1 * x;
    if (count < 9) return;
    Real xx = x * x, yy = y * y, zz = z * z;
    basis[4] = 1.0925484305920792f * (x * y);
    basis[5] = -1.0925484305920792f * (y * z);
    basis[6] = 0.31539156525252005f * (2.0f * zz - xx - yy);
    basis[7] = -1.0925484305920792f * (x * z);
    basis[8] = 0.5462742152960396f * (xx - yy);
    if (count < 16) return;
    basis[9] = -0.5900435899266435f * (y * (3.0f * xx - yy));
    basis[10] = 2.890611442640554f * (x * y * z);
    basis[11] = -0.4570457994644658f * (y * (4.0f * zz - xx - yy));
    basis[12] = 0.3731763325901154f * (z * (2.0f * zz - 3.0f * xx - 3.0f * yy));
    basis[13] = -0.4570457994644658f * (x * (4.0f * zz - xx - yy));
    basis[14] = 1.445305721320277f * (z * (xx - yy));
    basis[15] = -0.5900435899266435f * (x * (xx - 3.0f * yy));
}

// Gradient with respect to the direction of sum_k weight_k Y_k(direction), the polynomials taken as written above.
RASTER_FN void harmonics_gradient(int count, Real x, Real y, Real z, const Real* weight, Real* out) {
    const float c1 = 0.4886025119029199f;
    Real gx = -c1 * weight[3], gy = -c1 * weight[1], gz = c1 * weight[2];
    if (count >= 9) {
        const float a = 1.0925484305920792f, b = 2.0f * 0.31539156525252005f, c = 2.0f * 0.5462742152960396f;
        gx += a * (y * weight[4] - z * weight[7]) - b * (x * weight[6]) + c * (x * weight[8]);
        gy += a * (x * weight[4] - z * weight[5]) - b * (y * weight[6]) - c * (y * weight[8]);
        gz += -a * (y * weight[5] + x * weight[7]) + 2.0f * b * (z * weight[6]);
    }
    if (count >= 16) {
        const float a = 0.5900435899266435f, b = 2.890611442640554f, c = 0.4570457994644658f, d = 0.3731763325901154f,
                    e = 1.445305721320277f;
        Real xx = x * x, yy = y * y, zz = z * z, xy = x * y, xz = x * z, yz = y * z;
        gx += -6.0f * a * (xy * weight[9]) + b * (yz * weight[10]) + 2.0f * c * (xy * weight[11]) -
              6.0f * d * (xz * weight[12]) - c * ((4.0f * zz - 3.0f * xx - yy) * weight[13]) +
              2.0f * e * (xz * weight[14]) - 3.0f * a * ((xx - yy) * weight[15]);
        gy += -3.0f * a * ((xx - yy) * weight[9]) + b * (xz * weight[10]) -
              c * ((4.0f * zz - xx - 3.0f * yy) * weight[11]) - 6.0f * d * (yz * weight[12]) +
              2.0f * c * (xy * weight[13]) - 2.0f * e * (yz * weight[14]) + 6.0f * a * (xy * weight[15]);
        gz += b * (xy * weight[10]) - 8.0f * c * (yz * weight[11]) +
              3.0f * d * ((2.0f * zz - xx - yy) * weight[12]) - 8.0f * c * (xz * weight[13]) +
              e * ((xx - yy) * weight[14]);
    }
    out[0] = gx;
    out[1] = gy;
    out[2] = gz;
}

// What the projection and its gradient both need.
struct Geometry {
    Real view[3];                    // mean in camera axes
    Real rotation[9], unit[4];       // of the Gaussian in the world, and its unit quaternion
    Real inverse_norm;               // of the quaternion
    Real scale[3];
    Real inverse_z, slope_x, slope_y;  // slopes x / z, y / z after clamping
    Mask clamped_x, clamped_y;
    Real j00, j02, j11, j12;         // Jacobian of the perspective, rows of 2 x 3 without the zeros
    Real world_j[6];                 // Jacobian times the camera's rotation, 2 x 3
    Mask usable;                     // finite, and in front of the near plane
};

RASTER_FN Geometry geometry_of(const Camera& c, const Real* mean, const Real* log_scale, const Real* quaternion) {
    Geometry g;
    for (int i = 0; i < 3; i++) {
        const float* r = c.rotation + 3 * i;
        g.view[i] = r[0] * mean[0] + r[1] * mean[1] + r[2] * mean[2] + c.translation[i];
        g.scale[i] = exponential(log_scale[i]);
    }
    Real w = quaternion[0], x = quaternion[1], y = quaternion[2], z = quaternion[3];
    Real norm2 = w * w + x * x + y * y + z * z;
    Real finite = (mean[0] + mean[1] + mean[2] + log_scale[0] + log_scale[1] + log_scale[2] + norm2) * 0.0f;
    g.usable = (finite == splat(0.0f)) & (norm2 > splat(1e-30f)) & (g.view[2] >= splat(c.near));
    g.inverse_norm = 1.0f / square_root(norm2);
    w *= g.inverse_norm;
    x *= g.inverse_norm;
    y *= g.inverse_norm;
    z *= g.inverse_norm;
    g.unit[0] = w;
    g.unit[1] = x;
    g.unit[2] = y;
    g.unit[3] = z;
    g.rotation[0] = 1.0f - 2.0f * (y * y + z * z);
    g.rotation[1] = 2.0f * (x * y - w * z);
    g.rotation[2] = 2.0f * (x * z + w * y);
    g.rotation[3] = 2.0f * (x * y + w * z);
    g.rotation[4] = 1.0f - 2.0f * (x * x + z * z);
    g.rotation[5] = 2.0f * (y * z - w * x);
    g.rotation[6] = 2.0f * (x * z - w * y);
    g.rotation[7] = 2.0f * (y * z + w * x);
    g.rotation[8] = 1.0f - 2.0f * (x * x + y * y);
    g.inverse_z = 1.0f / g.view[2];
    Real sx = g.view[0] * g.inverse_z, sy = g.view[1] * g.inverse_z;
    g.clamped_x = (sx < splat(c.x_low)) | (sx > splat(c.x_high));
    g.clamped_y = (sy < splat(c.y_low)) | (sy > splat(c.y_high));
    g.slope_x = clamp(sx, c.x_low, c.x_high);
    g.slope_y = clamp(sy, c.y_low, c.y_high);
    g.j00 = c.fx * g.inverse_z;
    g.j11 = c.fy * g.inverse_z;
    g.j02 = -g.j00 * g.slope_x;
    g.j12 = -g.j11 * g.slope_y;
    for (int i = 0; i < 3; i++) {
        g.world_j[i] = g.j00 * c.rotation[i] + g.j02 * c.rotation[6 + i];
        g.world_j[3 + i] = g.j11 * c.rotation[3 + i] + g.j12 * c.rotation[6 + i];
    }
    return g;
}

// The two rows of Jacobian * camera rotation * rotation * scale; their products are the screen covariance.
RASTER_FN void screen_factors(const Geometry& g, Real* row0, Real* row1) {
    for (int j = 0; j < 3; j++) {
        const Real* r = g.rotation;
        row0[j] = (g.world_j[0] * r[j] + g.world_j[1] * r[3 + j] + g.world_j[2] * r[6 + j]) * g.scale[j];
        row1[j] = (g.world_j[3] * r[j] + g.world_j[4] * r[3 + j] + g.world_j[5] * r[6 + j]) * g.scale[j];
    }
}

RASTER_FN Real inverse_length(const Camera& c, const Real* mean, Real* direction) {
    Real d2 = splat(1e-30f);
    for (int i = 0; i < 3; i++) {
        direction[i] = mean[i] - c.center[i];
        d2 += direction[i] * direction[i];
    }
    Real inverse = 1.0f / square_root(d2);
    for (int i = 0; i < 3; i++) direction[i] *= inverse;
    return inverse;
}

// 0.5 + sum_k sh_k Y_k(direction), not clipped.
template <class Coefficient>
RASTER_FN void color_of(int count, const Camera& c, const Real* mean, Coefficient coefficient, Real* color) {
    Real basis[16], direction[3] = {splat(0.0f), splat(0.0f), splat(0.0f)};
    if (count > 1) inverse_length(c, mean, direction);
    harmonics(count, direction[0], direction[1], direction[2], basis);
    for (int channel = 0; channel < 3; channel++) color[channel] = splat(0.5f);
    for (int k = 0; k < count; k++)
        for (int channel = 0; channel < 3; channel++) color[channel] += basis[k] * coefficient(k, channel);
}

struct Coefficients {
    const float* sh;
    const int* index;
    int count;
    RASTER_FN_MEMBER Real operator()(int k, int channel) const {
        return gather(sh + 3 * k + channel, index, 3 * count);
    }
};

template <class State>
RASTER_FN void load_parameters(State& s, const int* index, Real* mean, Real* log_scale, Real* quaternion) {
    for (int i = 0; i < 3; i++) {
        mean[i] = gather(s.means.data + i, index, 3);
        log_scale[i] = gather(s.log_scales.data + i, index, 3);
    }
    for (int i = 0; i < 4; i++) quaternion[i] = gather(s.quaternions.data + i, index, 4);
}

// Projects Gaussians first .. first + count - 1 (count <= LANES) into `splats`, `keys`, `visible` and `radii`.
template <class State>
RASTER_FN void project(State& s, int first, int count) {
    const Camera& c = *reinterpret_cast<const Camera*>(s.camera.data);
    int index[LANES];
    for (int i = 0; i < LANES; i++) index[i] = first + imin(i, count - 1);
    Real mean[3], log_scale[3], quaternion[4], row0[3], row1[3], color[3];
    load_parameters(s, index, mean, log_scale, quaternion);
    Geometry g = geometry_of(c, mean, log_scale, quaternion);
    screen_factors(g, row0, row1);
    Real a = row0[0] * row0[0] + row0[1] * row0[1] + row0[2] * row0[2] + RASTER_LOW_PASS;
    Real b = row0[0] * row1[0] + row0[1] * row1[1] + row0[2] * row1[2];
    Real d = row1[0] * row1[0] + row1[1] * row1[1] + row1[2] * row1[2] + RASTER_LOW_PASS;
    Real determinant = a * d - b * b;
    Real inverse = 1.0f / determinant;

    Coefficients sh = {s.sh.data, index, s.sh_count};
    color_of(s.sh_count, c, mean, sh, color);
    Real logit = gather(s.opacity_logits.data, index, 1);
    Real opacity = 1.0f / (1.0f + exponential(-logit));
    Real cutoff = -log2_of(greatest(opacity, splat(1e-30f)) * (1.0f / RASTER_ALPHA_MIN));
    // Where the exponent reaches the cutoff: dx^2 <= -2 ln2 cutoff a.
    Real reach = square_root(greatest(-2.0f * RASTER_LN_2 * cutoff, splat(0.0f)));
    Real extent_x = reach * square_root(a), extent_y = reach * square_root(d);
    Real x = c.fx * (g.view[0] * g.inverse_z) + c.cx, y = c.fy * (g.view[1] * g.inverse_z) + c.cy;
    Real middle = 0.5f * (a + d);
    Real major = middle + square_root(greatest(middle * middle - determinant, splat(0.0f)));
    Real finite = (x + y + a + d + inverse + color[0] + color[1] + color[2] + logit) * 0.0f;
    Mask drawn = g.usable & (finite == splat(0.0f)) & (determinant > splat(0.0f)) & (cutoff < splat(0.0f)) &
                 (x + extent_x > splat(0.0f)) & (x - extent_x < splat((float)s.width)) &
                 (y + extent_y > splat(0.0f)) & (y - extent_y < splat((float)s.height));

    for (int i = 0; i < count; i++) {
        bool shown = lane_is_set(drawn, i);
        int n = first + i;
        Splat& o = reinterpret_cast<Splat*>(s.splats.data)[n];
        const float half_log2_e = -0.5f * RASTER_LOG2_E;
        o.x = lane(x, i);
        o.y = lane(y, i);
        o.xx = half_log2_e * lane(d, i) * lane(inverse, i);
        o.xy = RASTER_LOG2_E * lane(b, i) * lane(inverse, i);
        o.yy = half_log2_e * lane(a, i) * lane(inverse, i);
        o.opacity = lane(opacity, i);
        for (int channel = 0; channel < 3; channel++) {
            float v = lane(color[channel], i);
            o.color[channel] = v > 0.0f ? v : 0.0f;
        }
        o.depth = lane(g.view[2], i);
        o.cutoff = lane(cutoff, i);
        o.extent_x = shown ? lane(extent_x, i) : -1.0f;
        o.extent_y = shown ? lane(extent_y, i) : -1.0f;
        o.radius = shown ? 3.0f * sqrtf(lane(major, i)) : 0.0f;
        s.radii.data[n] = o.radius;
        s.visible.data[n] = shown;
        s.keys.data[n] = shown ? *reinterpret_cast<const unsigned*>(&o.depth) : 0xffffffffu;
    }
}

// From the moments of dL/d(exponent of e) over the pixels to the gradients of the parameters.
// moments: 0-2 colour, 3 depth, 4 sum of alpha dL/dalpha, 5-9 its moments dx, dy, dx^2, dx dy, dy^2,
// 10-11 sum of |dL/dx|, |dL/dy| over the pixels.
template <class State>
RASTER_FN void project_gradient(State& s, const int* index, const Real* moments, int count) {
    const Camera& c = *reinterpret_cast<const Camera*>(s.camera.data);
    Real mean[3], log_scale[3], quaternion[4], row0[3], row1[3], color[3];
    load_parameters(s, index, mean, log_scale, quaternion);
    Geometry g = geometry_of(c, mean, log_scale, quaternion);
    screen_factors(g, row0, row1);
    const float* packed = s.splats.data;
    Real opacity = gather(packed + 5, index, SPLAT_FLOATS);
    // Back from exponents of two to the conic (inverse covariance).
    Real conic_a = gather(packed + 2, index, SPLAT_FLOATS) * (-2.0f * RASTER_LN_2);
    Real conic_b = gather(packed + 3, index, SPLAT_FLOATS) * -RASTER_LN_2;
    Real conic_c = gather(packed + 4, index, SPLAT_FLOATS) * (-2.0f * RASTER_LN_2);
    Real extent = gather(packed + 11, index, SPLAT_FLOATS);
    Mask drawn = extent >= splat(0.0f);

    Real grad_x = conic_a * moments[5] + conic_b * moments[6];
    Real grad_y = conic_b * moments[5] + conic_c * moments[6];
    Real grad_ca = -0.5f * moments[7], grad_cb = -0.5f * moments[8], grad_cc = -0.5f * moments[9];
    // covariance = conic^-1, so its gradient is -conic * G * conic with G symmetric.
    Real t00 = grad_ca * conic_a + grad_cb * conic_b, t01 = grad_ca * conic_b + grad_cb * conic_c;
    Real t10 = grad_cb * conic_a + grad_cc * conic_b, t11 = grad_cb * conic_b + grad_cc * conic_c;
    Real grad_a = -(conic_a * t00 + conic_b * t10);
    Real grad_b = -(conic_a * t01 + conic_b * t11) - (conic_b * t00 + conic_c * t10);
    Real grad_d = -(conic_b * t01 + conic_c * t11);

    Real grad_scale[3], grad_rotation[9], grad_world_j[6];
    for (int i = 0; i < 6; i++) grad_world_j[i] = splat(0.0f);
    for (int j = 0; j < 3; j++) {
        Real k0 = row0[j], k1 = row1[j];
        Real gk0 = 2.0f * grad_a * k0 + grad_b * k1, gk1 = 2.0f * grad_d * k1 + grad_b * k0;
        grad_scale[j] = gk0 * k0 + gk1 * k1;  // with respect to the logarithm
        gk0 *= g.scale[j];
        gk1 *= g.scale[j];
        for (int i = 0; i < 3; i++) {
            grad_world_j[i] += gk0 * g.rotation[3 * i + j];
            grad_world_j[3 + i] += gk1 * g.rotation[3 * i + j];
            grad_rotation[3 * i + j] = gk0 * g.world_j[i] + gk1 * g.world_j[3 + i];
        }
    }
    const float *r0 = c.rotation, *r1 = c.rotation + 3, *r2 = c.rotation + 6;
    Real grad_j00 = grad_world_j[0] * r0[0] + grad_world_j[1] * r0[1] + grad_world_j[2] * r0[2];
    Real grad_j02 = grad_world_j[0] * r2[0] + grad_world_j[1] * r2[1] + grad_world_j[2] * r2[2];
    Real grad_j11 = grad_world_j[3] * r1[0] + grad_world_j[4] * r1[1] + grad_world_j[5] * r1[2];
    Real grad_j12 = grad_world_j[3] * r2[0] + grad_world_j[4] * r2[1] + grad_world_j[5] * r2[2];

    // A clamped slope is a constant: then j02 depends on z once (through 1 / z), otherwise twice.
    Real iz = g.inverse_z, zero = splat(0.0f);
    Real grad_view[3];
    grad_view[0] = g.j00 * (grad_x - select(g.clamped_x, zero, grad_j02 * iz));
    grad_view[1] = g.j11 * (grad_y - select(g.clamped_y, zero, grad_j12 * iz));
    grad_view[2] = moments[3] - iz * (grad_x * g.j00 * g.view[0] + grad_y * g.j11 * g.view[1] +
                                      grad_j00 * g.j00 + grad_j11 * g.j11 +
                                      select(g.clamped_x, splat(1.0f), splat(2.0f)) * grad_j02 * g.j02 +
                                      select(g.clamped_y, splat(1.0f), splat(2.0f)) * grad_j12 * g.j12);
    Real grad_mean[3];
    for (int i = 0; i < 3; i++) grad_mean[i] = r0[i] * grad_view[0] + r1[i] * grad_view[1] + r2[i] * grad_view[2];

    // Colour: nothing flows where it was clipped at zero.
    Coefficients sh = {s.sh.data, index, s.sh_count};
    Real grad_color[3], basis[16], direction[3] = {zero, zero, zero};
    for (int channel = 0; channel < 3; channel++) {
        color[channel] = gather(packed + 6 + channel, index, SPLAT_FLOATS);
        grad_color[channel] = select(drawn & (color[channel] > zero), moments[channel], zero);
    }
    if (s.sh_count > 1) {
        Real inverse = inverse_length(c, mean, direction), weight[16], grad_direction[3];
        for (int k = 1; k < s.sh_count; k++)
            weight[k] = sh(k, 0) * grad_color[0] + sh(k, 1) * grad_color[1] + sh(k, 2) * grad_color[2];
        harmonics_gradient(s.sh_count, direction[0], direction[1], direction[2], weight, grad_direction);
        Real along =
            direction[0] * grad_direction[0] + direction[1] * grad_direction[1] + direction[2] * grad_direction[2];
        for (int i = 0; i < 3; i++) grad_mean[i] += (grad_direction[i] - direction[i] * along) * inverse;
    }
    harmonics(s.sh_count, direction[0], direction[1], direction[2], basis);

    const Real* q = grad_rotation;
    Real w = g.unit[0], x = g.unit[1], y = g.unit[2], z = g.unit[3], grad_unit[4];
    grad_unit[0] = 2.0f * (x * (q[7] - q[5]) + y * (q[2] - q[6]) + z * (q[3] - q[1]));
    grad_unit[1] = 2.0f * (y * (q[1] + q[3]) + z * (q[2] + q[6]) + w * (q[7] - q[5]) - 2.0f * x * (q[4] + q[8]));
    grad_unit[2] = 2.0f * (x * (q[1] + q[3]) + z * (q[5] + q[7]) + w * (q[2] - q[6]) - 2.0f * y * (q[0] + q[8]));
    grad_unit[3] = 2.0f * (x * (q[2] + q[6]) + y * (q[5] + q[7]) + w * (q[3] - q[1]) - 2.0f * z * (q[0] + q[4]));
    Real radial = grad_unit[0] * w + grad_unit[1] * x + grad_unit[2] * y + grad_unit[3] * z;
    Real grad_quaternion[4], grad_logit = moments[4] * (1.0f - opacity);
    Real total = grad_logit + grad_color[0] + grad_color[1] + grad_color[2];
    for (int i = 0; i < 4; i++) {
        grad_quaternion[i] = (grad_unit[i] - g.unit[i] * radial) * g.inverse_norm;
        total += grad_quaternion[i];
    }
    for (int i = 0; i < 3; i++) total += grad_mean[i] + grad_scale[i];
    // A gradient that is not finite must not reach the optimiser: such a Gaussian stands still for this step.
    Mask keep = drawn & is_finite(total);

    float to_ndc_x = 0.5f * s.width, to_ndc_y = 0.5f * s.height;
    Real screen = square_root(grad_x * grad_x * (to_ndc_x * to_ndc_x) + grad_y * grad_y * (to_ndc_y * to_ndc_y));
    Real screen_abs = square_root(moments[10] * moments[10] * (to_ndc_x * to_ndc_x) +
                                  moments[11] * moments[11] * (to_ndc_y * to_ndc_y));
    for (int i = 0; i < count; i++) {
        int n = index[i];
        bool kept = lane_is_set(keep, i);
        for (int j = 0; j < 3; j++) {
            s.grad_means.data[3 * n + j] = kept ? lane(grad_mean[j], i) : 0.0f;
            s.grad_log_scales.data[3 * n + j] = kept ? lane(grad_scale[j], i) : 0.0f;
        }
        for (int j = 0; j < 4; j++) s.grad_quaternions.data[4 * n + j] = kept ? lane(grad_quaternion[j], i) : 0.0f;
        s.grad_opacity_logits.data[n] = kept ? lane(grad_logit, i) : 0.0f;
        for (int k = 0; k < s.sh_count; k++)
            for (int channel = 0; channel < 3; channel++)
                s.grad_sh.data[(long long)n * 3 * s.sh_count + 3 * k + channel] =
                    kept ? lane(basis[k], i) * lane(grad_color[channel], i) : 0.0f;
        s.grad_screen.data[n] = kept ? lane(screen, i) : 0.0f;
        s.grad_screen_abs.data[n] = kept ? lane(screen_abs, i) : 0.0f;
        s.touched.data[n] = kept;
    }
}

// The same for colours alone: dL/dsh of degree 0, zero for the higher degrees.
template <class State>
RASTER_FN void color_gradient(State& s, int n, const float* moments) {
    const Splat& o = reinterpret_cast<const Splat*>(s.splats.data)[n];
    float total = moments[0] + moments[1] + moments[2];
    bool kept = o.extent_x >= 0.0f && total - total == 0.0f;
    float* out = s.grad_sh.data + (long long)n * 3 * s.sh_count;
    for (int i = 0; i < 3 * s.sh_count; i++)
        out[i] = i < 3 && kept && o.color[i] > 0.0f ? 0.28209479177387814f * moments[i] : 0.0f;
    s.touched.data[n] = kept;
}

}  // namespace raster
