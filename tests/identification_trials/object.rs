//! What is photographed: codes and plain targets on the faces of an object.

use std::collections::BTreeMap;

use nalgebra::{Vector2, Vector3};
use rand::RngExt as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::geometry::Circle;
use tiepoint::targets::{DOT420_AXES, Family, dot420_table};

use super::recipe::{Form, Layout, Recipe};

/// Diameter of every dot and pitch of the codes, mm.
pub(crate) const DOT_MM: f64 = 5.0;
/// Half side of the plate of a code, which stays free of plain targets, mm.
const PLATE_MM: f64 = 22.0;
/// Foreign dots come no nearer to those of a code, mm.
const NEAREST_TO_CODE_MM: f64 = 3.0 * DOT_MM;
/// Width of a face over its height.
const ASPECT: f64 = 1.4;

/// A target with the plane that it lies in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    pub(crate) place: Vector3<f64>,
    pub(crate) normal: Vector3<f64>,
}

impl Spot {
    pub(crate) fn circle(&self) -> Circle {
        Circle {
            normal: self.normal,
            radius_mm: 0.5 * DOT_MM,
        }
    }
}

/// A code: its number and its six dots.
#[derive(Clone, Debug)]
pub(crate) struct CodeSpot {
    pub(crate) id: u32,
    pub(crate) dots: Vec<Spot>,
}

/// A face, laid out flat: how it is bent and where it is.
struct Face {
    width: f64,
    height: f64,
    /// Own number, which places it.
    index: usize,
}

/// Everything that carries dots.
pub(crate) struct Object {
    form: Form,
    faces: Vec<Face>,
    pub(crate) width: f64,
    phases: [f64; 4],
    levels: Vec<f64>,
    pub(crate) targets: Vec<Spot>,
    pub(crate) codes: Vec<CodeSpot>,
    /// Where glints lie: face and place on it.
    pub(crate) glints: Vec<(usize, Vector2<f64>)>,
}

impl Object {
    pub(crate) fn of(recipe: &Recipe, random: &mut ChaCha8Rng) -> Self {
        let spacing = recipe.spacing * DOT_MM;
        let area = recipe.targets as f64 * spacing * spacing * 1.15
            + recipe.codes as f64 * 4.0 * (PLATE_MM + 0.5 * spacing).powi(2) * 1.2;
        let count = if recipe.form == Form::Box { 5 } else { 1 };
        // Top: w x h, sides of height h / 2: their shares of the area as the faces come.
        let width = match recipe.form {
            Form::Box => (area / (1.0 / ASPECT + (1.0 + 1.0 / ASPECT) * 0.5)).sqrt(),
            _ => (area * ASPECT).sqrt(),
        };
        let depth = width / ASPECT;
        let faces = (0..count)
            .map(|index| Face {
                width: if index >= 3 { depth } else { width },
                height: if index == 0 {
                    depth
                } else {
                    0.25 * width * 2.0
                },
                index,
            })
            .collect();
        let mut object = Self {
            form: recipe.form,
            faces,
            width,
            phases: std::array::from_fn(|_| random.random_range(0.0..std::f64::consts::TAU)),
            levels: (0..16)
                .map(|_| random.random_range(0.0..0.12) * width)
                .collect(),
            targets: Vec::new(),
            codes: Vec::new(),
            glints: Vec::new(),
        };
        object.furnish(recipe, spacing, random);
        object
    }

    fn furnish(&mut self, recipe: &Recipe, spacing: f64, random: &mut ChaCha8Rng) {
        let mut ids: Vec<u32> = (1..=Family::Dot420.code_count()).collect();
        ids.shuffle(random);
        let total: f64 = self.faces.iter().map(|f| f.width * f.height).sum();
        let mut taken: BTreeMap<usize, Vec<Vector2<f64>>> = BTreeMap::new();
        let mut dots: BTreeMap<usize, Vec<Vector2<f64>>> = BTreeMap::new();
        for face in 0..self.faces.len() {
            let share = self.faces[face].width * self.faces[face].height / total;
            let wanted = ((recipe.codes as f64 * share).round() as usize).max(2);
            for _ in 0..wanted {
                let plates = taken.entry(face).or_default();
                if let Some(centre) = self.free_plate(face, plates, random) {
                    plates.push(centre);
                    let id = ids.pop().expect("fewer codes than numbers");
                    let turn = random.random_range(0.0..std::f64::consts::TAU);
                    let spots = self.code(face, centre, id, turn, dots.entry(face).or_default());
                    self.codes.push(spots);
                }
            }
            let free = |place: &Vector2<f64>| {
                let off_plates = taken
                    .get(&face)
                    .is_none_or(|plates| plates.iter().all(|p| (p - place).norm() > PLATE_MM));
                off_plates
                    && dots.get(&face).is_none_or(|dots| {
                        dots.iter()
                            .all(|d| (d - place).norm() > NEAREST_TO_CODE_MM.min(spacing))
                    })
            };
            let wanted = (recipe.targets as f64 * share).round() as usize;
            let mut places = match recipe.layout {
                Layout::Grid => self.grid(face, spacing, &free),
                Layout::Random => self.scattered(face, spacing, wanted, &free, random),
            };
            if recipe.layout == Layout::Random {
                places.truncate(wanted);
            }
            let room = recipe.targets.saturating_sub(self.targets.len());
            places.truncate(if face + 1 == self.faces.len() {
                room
            } else {
                wanted
            });
            for place in places {
                self.targets.push(self.spot(face, &place));
            }
            let glints = (recipe.glints * recipe.targets as f64 * share).round() as usize;
            for _ in 0..glints {
                let place = self.anywhere(face, random);
                self.glints.push((face, place));
            }
        }
    }

    fn anywhere(&self, face: usize, random: &mut ChaCha8Rng) -> Vector2<f64> {
        let face = &self.faces[face];
        Vector2::new(
            random.random_range(-0.5..0.5) * (face.width - 2.0 * DOT_MM),
            random.random_range(-0.5..0.5) * (face.height - 2.0 * DOT_MM),
        )
    }

    /// Of several places the one farthest from all plates, where it touches none.
    fn free_plate(
        &self,
        face: usize,
        plates: &[Vector2<f64>],
        random: &mut ChaCha8Rng,
    ) -> Option<Vector2<f64>> {
        let room = |p: &Vector2<f64>| {
            let away = plates.iter().map(|q| (p - q).norm());
            away.fold(f64::INFINITY, f64::min)
        };
        let (width, height) = (self.faces[face].width, self.faces[face].height);
        let half = Vector2::new(width, height).map(|side| (0.5 * side - PLATE_MM).max(1.0));
        let tries = (0..40).map(|_| {
            Vector2::new(
                random.random_range(-half.x..half.x),
                random.random_range(-half.y..half.y),
            )
        });
        tries
            .max_by(|a, b| room(a).total_cmp(&room(b)))
            .filter(|best| room(best) > 2.0 * PLATE_MM)
    }

    fn code(
        &self,
        face: usize,
        centre: Vector2<f64>,
        id: u32,
        turn: f64,
        taken: &mut Vec<Vector2<f64>>,
    ) -> CodeSpot {
        let middle = self.spot(face, &centre);
        let (u, v) = self.directions(face, &centre);
        let (sin, cos) = turn.sin_cos();
        let (x, y) = (u * cos + v * sin, v * cos - u * sin);
        let table = &dot420_table()[id as usize - 1];
        let dots = DOT420_AXES
            .iter()
            .chain(table)
            .map(|[a, b]| {
                let (a, b) = (f64::from(a - 3) * DOT_MM, f64::from(b - 3) * DOT_MM);
                taken.push(centre + Vector2::new(cos * a - sin * b, sin * a + cos * b));
                // A code is a flat plate, whatever carries it.
                Spot {
                    place: middle.place + x * a + y * b,
                    normal: middle.normal,
                }
            })
            .collect();
        CodeSpot { id, dots }
    }

    fn grid(
        &self,
        face: usize,
        spacing: f64,
        free: &impl Fn(&Vector2<f64>) -> bool,
    ) -> Vec<Vector2<f64>> {
        let (width, height) = (self.faces[face].width, self.faces[face].height);
        let columns = ((width - 2.0 * DOT_MM) / spacing) as i32;
        let rows = ((height - 2.0 * DOT_MM) / spacing) as i32;
        let mut places = Vec::new();
        for row in 0..=rows {
            for column in 0..=columns {
                let place = Vector2::new(
                    (f64::from(column) - f64::from(columns) / 2.0) * spacing,
                    (f64::from(row) - f64::from(rows) / 2.0) * spacing,
                );
                if free(&place) {
                    places.push(place);
                }
            }
        }
        places
    }

    fn scattered(
        &self,
        face: usize,
        spacing: f64,
        wanted: usize,
        free: &impl Fn(&Vector2<f64>) -> bool,
        random: &mut ChaCha8Rng,
    ) -> Vec<Vector2<f64>> {
        let cell = |p: &Vector2<f64>| {
            (
                (p.x / spacing).floor() as i32,
                (p.y / spacing).floor() as i32,
            )
        };
        // The field is as dense as asked for where many stand at the least distance: darts leave it thinner.
        let least = 0.8 * spacing.max(2.5 * DOT_MM);
        let least = least.max(2.0 * DOT_MM);
        let mut index: BTreeMap<(i32, i32), Vec<Vector2<f64>>> = BTreeMap::new();
        let mut places = Vec::new();
        for _ in 0..60 * wanted {
            if places.len() == wanted {
                break;
            }
            let place = self.anywhere(face, random);
            let (i, j) = cell(&place);
            let near = (i - 2..=i + 2)
                .flat_map(|i| (j - 2..=j + 2).map(move |j| (i, j)))
                .filter_map(|key| index.get(&key))
                .flatten()
                .any(|q| (q - place).norm() < least);
            if !near && free(&place) {
                index.entry((i, j)).or_default().push(place);
                places.push(place);
            }
        }
        places
    }

    /// A place of a face in space, with the outward normal.
    pub(crate) fn spot(&self, face: usize, place: &Vector2<f64>) -> Spot {
        let (u, v) = self.directions(face, place);
        Spot {
            place: self.in_space(face, place),
            normal: u.cross(&v).normalize(),
        }
    }

    /// Unit vectors of the tangent plane, at right angles.
    fn directions(&self, face: usize, place: &Vector2<f64>) -> (Vector3<f64>, Vector3<f64>) {
        /// Step of the differences, mm.
        const STEP: f64 = 0.01;
        if self.form == Form::Steps {
            return (Vector3::x(), Vector3::y());
        }
        let ahead = |step: Vector2<f64>| {
            self.in_space(face, &(place + step)) - self.in_space(face, &(place - step))
        };
        let u = ahead(Vector2::new(STEP, 0.0)).normalize();
        let v = ahead(Vector2::new(0.0, STEP));
        let v = (v - u * u.dot(&v)).normalize();
        (u, v)
    }

    fn in_space(&self, face: usize, place: &Vector2<f64>) -> Vector3<f64> {
        let (x, y) = (place.x, place.y);
        match self.form {
            Form::Flat => Vector3::new(x, y, 0.0),
            Form::Waves => {
                let (a, b) = (0.22 * self.width, 0.27 * self.width);
                let z = 0.06
                    * self.width
                    * ((x / a + self.phases[0]).sin() + (y / b + self.phases[1]).sin());
                Vector3::new(x, y, z)
            }
            Form::Cylinder => {
                let radius = self.width / 2.4;
                let angle = x / radius;
                Vector3::new(radius * angle.sin(), y, radius * angle.cos() - radius)
            }
            Form::Steps => {
                let column = ((x / self.width + 0.5) * 4.0).floor().clamp(0.0, 3.0) as usize;
                let row = ((y * ASPECT / self.width + 0.5) * 4.0)
                    .floor()
                    .clamp(0.0, 3.0) as usize;
                Vector3::new(x, y, self.levels[4 * row + column])
            }
            Form::Box => {
                let (w, d) = (self.width / 2.0, self.width / ASPECT / 2.0);
                let down = -0.25 * self.width;
                match self.faces[face].index {
                    0 => Vector3::new(x, y, 0.0),
                    1 => Vector3::new(x, -d, down + y),
                    2 => Vector3::new(-x, d, down + y),
                    3 => Vector3::new(w, x, down + y),
                    _ => Vector3::new(-w, -x, down + y),
                }
            }
        }
    }
}
