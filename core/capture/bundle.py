"""Bundle adjustment of a reconstruction (Triggs et al. 2000) by pycolmap; the same bits every time."""

from __future__ import annotations

import pycolmap

THREADS = 1
"""For whatever sums over observations: in another order they would be other bits, and then another reconstruction. Two
threads are no faster for the captures of this project."""

_LITTLE = 1e-6  # share of the cost that a step has to save; without it all are made, which takes six times as long


def adjust(model: pycolmap.Reconstruction, *, robust: bool, steps: int = 100) -> None:
    """Adjust poses, lenses and points of all registered images to their observations.

    Args:
        model: changed in place.
        robust: let a wrong match pull less than a right one (soft L1).
        steps: at most.
    """
    config = pycolmap.BundleAdjustmentConfig()
    for image in model.reg_image_ids():
        config.add_image(image)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    if robust:
        options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.solver_options.max_num_iterations = steps
    options.ceres.solver_options.function_tolerance = _LITTLE
    options.ceres.solver_options.num_threads = THREADS
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()


def extended_params(params: list[float], larger: pycolmap.Camera) -> list[float]:
    """The numbers of a camera for the `larger` model of its family, whose further ones stand last and begin at zero."""
    return [*params, *larger.params[len(params) :]]
