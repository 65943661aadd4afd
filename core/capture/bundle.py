"""Bundle adjustment of a reconstruction (Triggs et al. 2000) by pycolmap; the same bits every time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pycolmap
from numpy.typing import NDArray

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
    config, options = _all_images(model), _options(steps)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    if robust:
        options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()


def adjust_near(
    model: pycolmap.Reconstruction,
    centers: Mapping[int, NDArray[np.float64]],
    deviation: float,
    *,
    reach: float,
    steps: int,
) -> None:
    """Adjust poses and points, with lenses as they are, where it is roughly known from where images were taken.

    What few matches hold together would otherwise bend, and what none do would drift away.

    Args:
        model: changed in place; it is aligned with the centres.
        centers: (3,) of each registered image's camera; single ones may be wrong.
        deviation: from these that is expected, in their unit.
        reach: pixels from which on an observation hardly pulls any more.
        steps: at most.
    """
    config, options = _all_images(model), _options(steps)
    for camera in model.cameras:
        config.set_constant_cam_intrinsics(camera)
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = reach
    priors, rules = [], pycolmap.PosePriorBundleAdjustmentOptions()
    rules.ceres.prior_position_loss_function_type = pycolmap.LossFunctionType.CAUCHY
    rules.alignment_ransac.random_seed = 0
    for image in model.reg_image_ids():
        prior = pycolmap.PosePrior(
            position=centers[image],
            position_covariance=np.eye(3) * deviation**2,
            coordinate_system=pycolmap.PosePriorCoordinateSystem.CARTESIAN,
        )
        prior.corr_data_id = model.image(image).data_id
        priors.append(prior)
    pycolmap.create_pose_prior_bundle_adjuster(options, rules, config, priors, model).solve()


def _all_images(model: pycolmap.Reconstruction) -> pycolmap.BundleAdjustmentConfig:
    config = pycolmap.BundleAdjustmentConfig()
    for image in model.reg_image_ids():
        config.add_image(image)
    return config


def _options(steps: int) -> pycolmap.BundleAdjustmentOptions:
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    options.ceres.solver_options.max_num_iterations = steps
    options.ceres.solver_options.function_tolerance = _LITTLE
    options.ceres.solver_options.num_threads = THREADS
    return options


def extended_params(params: list[float], larger: pycolmap.Camera) -> list[float]:
    """The numbers of a camera for the `larger` model of its family, whose further ones stand last and begin at zero."""
    return [*params, *larger.params[len(params) :]]
