//! Why an expected dot is not measured.

/// Why an expected dot is not measured, in one line for the operator.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NotThere {
    /// The prediction has no place, no ellipse or no covariance.
    #[error("no place or no ellipse is predicted")]
    Unpredicted,
    /// The centre lies beyond the picture's border.
    #[error("outside the picture, {beyond_px:.0} px beyond its border")]
    Outside {
        /// How far, px.
        beyond_px: f64,
    },
    /// The border cuts the dot or its blurred edge.
    #[error("cut off at the picture's border")]
    CutOffAtBorder,
    /// Larger than what is measured.
    #[error("too large: {major_px:.0} px, at most {largest_px:.0} px are measured")]
    TooLarge {
        /// Expected larger diameter, px.
        major_px: f64,
        /// The largest that is measured, px.
        largest_px: f64,
    },
    /// Neighbours leave too little of the dot.
    #[error("{}", in_words(*gap_px))]
    InShadowOf {
        /// The nearest neighbour by its place in the slice of dots.
        neighbour: usize,
        /// From outline to outline, px; negative where they overlap.
        gap_px: f64,
    },
    /// Light that nobody measured reaches over the dot's edge.
    #[error("touched by other light that is no measured dot")]
    Touched,
    /// The surroundings are saturated.
    #[error("glare: {:.0} % of its surroundings are saturated", 100.0 * share)]
    Saturated {
        /// Share of the surroundings' pixels.
        share: f64,
    },
    /// The surroundings are so uneven that they hide a dot.
    #[error("uneven surroundings: {rms:.1} grey values over noise of {noise:.1}")]
    Uneven {
        /// Root mean square of what is left of the surroundings after a plane, grey values.
        rms: f64,
        /// The noise, grey values.
        noise: f64,
    },
    /// Nothing is there, and a dot of the expected contrast would be seen.
    #[error("covered: {} where {expected:.1} are expected", above(*contrast))]
    Covered {
        /// Found, grey values.
        contrast: f64,
        /// Expected, grey values.
        expected: f64,
    },
    /// Noise could look as bright.
    #[error("too weak: {}, {needed:.1} needed", above(*contrast))]
    TooWeak {
        /// Found, grey values.
        contrast: f64,
        /// Needed, grey values.
        needed: f64,
    },
    /// What is there is no dot.
    #[error("nothing round can be fitted")]
    Unfitted,
    /// What is there does not look like a dot.
    #[error("partly covered or not round: misfit {:.0} % of its contrast", 100.0 * misfit)]
    NotRound {
        /// Misfit beyond the noise as a share of the contrast.
        misfit: f64,
    },
    /// What is there has another size or direction.
    #[error(
        "another shape: {:.1} x {:.1} px where {:.1} x {:.1} px are expected, {departure:.1} sigmas",
        found_px[0], found_px[1], expected_px[0], expected_px[1]
    )]
    OtherShape {
        /// The largest departure of a diameter or the direction, in sigmas.
        departure: f64,
        /// Full diameters, larger first, px.
        found_px: [f64; 2],
        /// Expected full diameters, px.
        expected_px: [f64; 2],
    },
    /// What is there does not agree with the predicted place.
    #[error("elsewhere: what shines there is {distance_px:.2} px off, {sigmas:.1} sigmas")]
    Elsewhere {
        /// From the predicted centre, px.
        distance_px: f64,
        /// Root of the chi-square of prediction and measurement.
        sigmas: f64,
    },
    /// The centre would be too uncertain to be of use.
    #[error("too uncertain: {sigma_px:.2} px, at most {largest_px:.2} px are of use")]
    TooUncertain {
        /// Standard deviation of the centre, px.
        sigma_px: f64,
        /// The largest that is of use, px.
        largest_px: f64,
    },
}

fn above(contrast: f64) -> String {
    match contrast > 0.0 {
        true => format!("{contrast:.1} grey values above its surroundings"),
        false => "no lighter than its surroundings".to_owned(),
    }
}

fn in_words(gap_px: f64) -> String {
    match gap_px >= 0.0 {
        true => format!("in the light of a neighbour {gap_px:.1} px from it"),
        false => format!("overlapped by a neighbour by {:.1} px", -gap_px),
    }
}
