//! How a network stands in its JSON file: things refer to each other by name, what is left out has its default.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{self, SeqAccess, Visitor};
use serde::ser::SerializeSeq;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::adjustment::ResidualPlane;
use crate::camera::LensDirection;
use crate::network::{BarRole, REFERENCE_CELSIUS};

/// What the file calls itself.
pub(super) const FORMAT: &str = "tiepoint-network";
/// The version that is written and read.
pub(super) const VERSION: u32 = 1;

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Form {
    pub(super) format: String,
    pub(super) version: u32,
    #[serde(default)]
    pub(super) residuals: ResidualPlane,
    /// Sigma of the observations that give none.
    #[serde(default)]
    pub(super) sigma_px: Option<f64>,
    /// Left out: control where there are control points, else inner constraints on all points.
    #[serde(default)]
    pub(super) datum: Option<DatumForm>,
    pub(super) cameras: Vec<CameraForm>,
    pub(super) images: Vec<ImageForm>,
    pub(super) points: Vec<PointForm>,
    pub(super) observations: Vec<ObservationForm>,
    #[serde(default)]
    pub(super) distances: Vec<DistanceForm>,
    #[serde(default)]
    pub(super) object: Option<ObjectForm>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraForm {
    pub(super) name: String,
    pub(super) width_px: u32,
    pub(super) height_px: u32,
    pub(super) pixel_pitch_mm: f64,
    #[serde(default)]
    pub(super) lens: LensDirection,
    pub(super) values: ValuesForm,
    /// Names of the free parameters; those that stand neither here nor in `weighted` are fixed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) free: Vec<String>,
    /// Sigmas of the weighted parameters by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) weighted: BTreeMap<String, f64>,
    /// Names of the free and weighted parameters that each image has for itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) per_image: Vec<String>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(
    non_snake_case,
    reason = "the parameters are called so wherever they stand"
)]
pub(super) struct ValuesForm {
    c: f64,
    #[serde(default)]
    x0: f64,
    #[serde(default)]
    y0: f64,
    #[serde(default)]
    K1: f64,
    #[serde(default)]
    K2: f64,
    #[serde(default)]
    K3: f64,
    #[serde(default)]
    P1: f64,
    #[serde(default)]
    P2: f64,
    #[serde(default)]
    B1: f64,
    #[serde(default)]
    B2: f64,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ImageForm {
    pub(super) name: String,
    /// Left out: the only camera.
    #[serde(default)]
    pub(super) camera: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) centre_mm: Option<[f64; 3]>,
    /// Rows of the matrix.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) camera_from_world: Option<[[f64; 3]; 3]>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PointForm {
    pub(super) name: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) start_mm: Option<[f64; 3]>,
    /// x, y, z; `null` for one that is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) known: Option<[Option<KnownForm>; 3]>,
    /// Left out: the known coordinates are not correlated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) correlations: Option<[f64; 3]>,
    /// Left out: control where a coordinate is known, else new.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) role: Option<RoleForm>,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct KnownForm {
    pub(super) value_mm: f64,
    /// Left out: the coordinate is fixed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) sigma_mm: Option<f64>,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum RoleForm {
    Control,
    Check,
    New,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DistanceForm {
    pub(super) name: String,
    pub(super) from: String,
    pub(super) to: String,
    pub(super) length_mm: f64,
    pub(super) sigma_mm: f64,
    #[serde(default = "control")]
    pub(super) role: BarRole,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) temperature_c: Option<f64>,
    /// Left out: 20 degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) calibrated_at_c: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) expansion_per_k: Option<f64>,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ObjectForm {
    pub(super) temperature_c: f64,
    #[serde(default = "reference")]
    pub(super) reference_c: f64,
    pub(super) expansion_per_k: f64,
}

fn reference() -> f64 {
    REFERENCE_CELSIUS
}

fn control() -> BarRole {
    BarRole::Control
}

/// `"control"`, `{"inner_constraints": "all"}` or `{"inner_constraints": ["P1", "P2", "P3"]}`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum DatumForm {
    InnerConstraints(DatumPointsForm),
    Control,
}

#[derive(Debug)]
pub(super) enum DatumPointsForm {
    All,
    Listed(Vec<String>),
}

/// `["image", "point", x_px, y_px]` or with sigma_px as a fifth; a number that is `null` is none.
#[derive(Debug)]
pub(super) struct ObservationForm {
    pub(super) image: String,
    pub(super) point: String,
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) sigma_px: Option<f64>,
}

impl ValuesForm {
    /// The form of values in the order of [`crate::camera::INTERIOR_NAMES`].
    pub(super) fn new([c, x0, y0, k1, k2, k3, p1, p2, b1, b2]: [f64; 10]) -> Self {
        Self {
            c,
            x0,
            y0,
            K1: k1,
            K2: k2,
            K3: k3,
            P1: p1,
            P2: p2,
            B1: b1,
            B2: b2,
        }
    }

    /// The values in the order of [`crate::camera::INTERIOR_NAMES`].
    pub(super) fn values(&self) -> [f64; 10] {
        [
            self.c, self.x0, self.y0, self.K1, self.K2, self.K3, self.P1, self.P2, self.B1, self.B2,
        ]
    }
}

impl Serialize for DatumPointsForm {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::All => serializer.serialize_str("all"),
            Self::Listed(names) => names.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for DatumPointsForm {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = DatumPointsForm;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"all\" or a list of names of points")
            }
            fn visit_str<E: de::Error>(self, text: &str) -> Result<Self::Value, E> {
                match text {
                    "all" => Ok(DatumPointsForm::All),
                    _ => Err(E::invalid_value(de::Unexpected::Str(text), &self)),
                }
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
                let mut names = Vec::new();
                while let Some(name) = list.next_element()? {
                    names.push(name);
                }
                Ok(DatumPointsForm::Listed(names))
            }
        }
        deserializer.deserialize_any(Reader)
    }
}

impl Serialize for ObservationForm {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut list =
            serializer.serialize_seq(Some(if self.sigma_px.is_some() { 5 } else { 4 }))?;
        list.serialize_element(&self.image)?;
        list.serialize_element(&self.point)?;
        list.serialize_element(&self.x_px)?;
        list.serialize_element(&self.y_px)?;
        if let Some(sigma) = &self.sigma_px {
            list.serialize_element(sigma)?;
        }
        list.end()
    }
}

impl<'de> Deserialize<'de> for ObservationForm {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = ObservationForm;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("[image, point, x_px, y_px] with or without sigma_px as a fifth")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
                let missing = |count| de::Error::invalid_length(count, &self);
                let read = ObservationForm {
                    image: list.next_element()?.ok_or_else(|| missing(0))?,
                    point: list.next_element()?.ok_or_else(|| missing(1))?,
                    x_px: list.next_element::<Number>()?.ok_or_else(|| missing(2))?.0,
                    y_px: list.next_element::<Number>()?.ok_or_else(|| missing(3))?.0,
                    sigma_px: list.next_element::<Number>()?.map(|number| number.0),
                };
                match list.next_element::<de::IgnoredAny>()? {
                    None => Ok(read),
                    Some(_) => Err(de::Error::invalid_length(6, &self)),
                }
            }
        }
        deserializer.deserialize_seq(Reader)
    }
}

/// A number of an image point, which may be none: `null`, or what stands for `NaN`.
struct Number(f64);

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;
        impl Visitor<'_> for Reader {
            type Value = Number;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number or null")
            }
            fn visit_f64<E: de::Error>(self, number: f64) -> Result<Number, E> {
                Ok(Number(number))
            }
            fn visit_u64<E: de::Error>(self, number: u64) -> Result<Number, E> {
                Ok(Number(number as f64))
            }
            fn visit_i64<E: de::Error>(self, number: i64) -> Result<Number, E> {
                Ok(Number(number as f64))
            }
            fn visit_unit<E: de::Error>(self) -> Result<Number, E> {
                Ok(Number(f64::NAN))
            }
            fn visit_bool<E: de::Error>(self, word: bool) -> Result<Number, E> {
                match word {
                    false => Ok(Number(f64::NAN)),
                    true => Err(E::invalid_type(de::Unexpected::Bool(word), &self)),
                }
            }
        }
        deserializer.deserialize_any(Reader)
    }
}

/// The text with `false` for every `NaN`, `Infinity` and `-Infinity` outside of words; `None` where there is none. Only an image point
/// may be without a number: `null` would do in other places too, where it says that nothing is known or that a coordinate is fixed.
pub(super) fn with_false_for_no_numbers(text: &str) -> Option<String> {
    const NO_NUMBERS: [&str; 3] = ["NaN", "-Infinity", "Infinity"];
    let mut changed = String::with_capacity(text.len());
    let mut rest = text;
    let mut found = false;
    while !rest.is_empty() {
        let end = rest.find('"').unwrap_or(rest.len());
        let mut plain = rest[..end].to_owned();
        for no_number in NO_NUMBERS {
            found |= plain.contains(no_number);
            plain = plain.replace(no_number, "false");
        }
        changed.push_str(&plain);
        rest = &rest[end..];
        let word = end_of_word(rest);
        changed.push_str(&rest[..word]);
        rest = &rest[word..];
    }
    found.then_some(changed)
}

/// Bytes of the word in quotation marks at the beginning of the text.
fn end_of_word(text: &str) -> usize {
    let mut escaped = false;
    for (at, byte) in text.bytes().enumerate().skip(1) {
        match byte {
            b'"' if !escaped => return at + 1,
            b'\\' => escaped = !escaped,
            _ => escaped = false,
        }
    }
    text.len()
}
