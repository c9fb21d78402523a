//! What warmth does to a scale bar and to the object between whose points it stands.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::{Network, ScaleBar};

/// The temperature to which lengths refer unless something else is said, degrees Celsius (ISO 1:2022).
pub const REFERENCE_CELSIUS: f64 = 20.0;

/// A body whose lengths refer to one temperature and which had another when it was photographed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Expansion {
    /// Coefficient of linear thermal expansion, 1/K; steel has some 11.5e-6, aluminium 23e-6.
    pub per_k: f64,
    /// Its temperature at the photographs, degrees Celsius.
    pub temperature_c: f64,
    /// The temperature to which its lengths refer, degrees Celsius.
    pub reference_c: f64,
}

impl Expansion {
    /// Coefficients that a body can have, 1/K: polymers reach 2e-4, and a coefficient in 1e-6/K lies far outside.
    pub const PER_K: RangeInclusive<f64> = -5e-4..=5e-4;

    /// Temperatures that a body can have, degrees Celsius, from absolute zero; within them no length falls to nothing.
    pub const CELSIUS: RangeInclusive<f64> = -273.15..=1000.0;

    /// How many times its length at the reference temperature the body is long at the photographs: `1 + a (T - T0)`.
    #[must_use]
    pub fn factor(&self) -> f64 {
        1.0 + self.per_k * (self.temperature_c - self.reference_c)
    }

    /// `at 30 C, 11.5e-6/K from 20 C`.
    fn in_words(&self) -> String {
        format!(
            "at {} C, {}e-6/K from {} C",
            self.temperature_c,
            // The coefficient in millionths, without the digits that the multiplication adds.
            (self.per_k * 1e12).round() / 1e6,
            self.reference_c
        )
    }
}

/// The distance of a bar's ends on the object at the object's reference temperature, to which coordinates are delivered, mm:
/// `L (1 + a_bar (T_bar - T_cal)) / (1 + a_obj (T_obj - T_ref))`, both factors in full.
#[must_use]
pub fn length_at_reference(
    calibrated_mm: f64,
    bar: Option<&Expansion>,
    object: Option<&Expansion>,
) -> f64 {
    let factor = |body: Option<&Expansion>| body.map_or(1.0, Expansion::factor);
    calibrated_mm * factor(bar) / factor(object)
}

/// Why a bar's length is used otherwise than it was calibrated; `None` where nothing is known of temperatures.
#[must_use]
pub fn reason_of_length(bar: Option<&Expansion>, object: Option<&Expansion>) -> Option<String> {
    let parts: Vec<String> = [("bar", bar), ("object", object)]
        .into_iter()
        .filter_map(|(name, body)| Some(format!("{name} {}", body?.in_words())))
        .collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}

impl Network {
    /// The length that a bar should have between the coordinates of its ends, mm ([`length_at_reference`]).
    #[must_use]
    pub fn bar_length_mm(&self, bar: &ScaleBar) -> f64 {
        length_at_reference(bar.length_mm, bar.expansion.as_ref(), self.object())
    }

    /// Why a bar's length is used otherwise than it was calibrated; `None` where nothing is known of temperatures.
    #[must_use]
    pub fn reason_of_bar_length(&self, bar: &ScaleBar) -> Option<String> {
        reason_of_length(bar.expansion.as_ref(), self.object())
    }

    /// What warmth does to the object, where it is known.
    #[must_use]
    pub fn object(&self) -> Option<&Expansion> {
        self.settings.targets.object.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(per_k: f64, temperature_c: f64) -> Expansion {
        Expansion {
            per_k,
            temperature_c,
            reference_c: REFERENCE_CELSIUS,
        }
    }

    #[test]
    fn a_metre_of_steel_grows_by_0_115_mm_in_ten_kelvin() {
        let steel = body(11.5e-6, 30.0);
        let length = length_at_reference(1000.0, Some(&steel), None);
        assert!((length - 1000.115).abs() < 1e-9, "{length}");
        assert_eq!(length_at_reference(1000.0, None, None), 1000.0);
    }

    #[test]
    fn a_bar_as_warm_as_an_object_of_its_metal_keeps_its_length() {
        let steel = body(11.5e-6, 37.0);
        let length = length_at_reference(1000.0, Some(&steel), Some(&steel));
        assert!((length - 1000.0).abs() < 1e-9, "{length}");
        // Both factors in full: the difference of the linear terms would give 999.885, 2.6e-5 mm more.
        let aluminium = body(23e-6, 30.0);
        let length = length_at_reference(1000.0, Some(&body(11.5e-6, 30.0)), Some(&aluminium));
        assert!((length - 1000.115 / 1.00023).abs() < 1e-9, "{length}");
        assert!((length - 999.885).abs() > 2e-5, "{length}");
    }

    #[test]
    fn a_length_that_differs_says_why() {
        assert_eq!(
            reason_of_length(Some(&body(11.5e-6, 30.0)), Some(&body(23e-6, 24.5))).unwrap(),
            "bar at 30 C, 11.5e-6/K from 20 C, object at 24.5 C, 23e-6/K from 20 C"
        );
        assert_eq!(reason_of_length(None, None), None);
    }
}
