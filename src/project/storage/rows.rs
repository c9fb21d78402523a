//! The network as rows `id -> JSON`, and which of them a change touches.

use std::collections::BTreeMap;
use std::fmt::{self, Debug};
use std::sync::Arc;

use rusqlite::ToSql;
use rusqlite::types::ToSqlOutput;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use super::NotStorable;
use crate::network::{ImageEntry, Label, Network};
use crate::targets::DotIndex;

/// A table of rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Table {
    /// What there is once.
    Document,
    /// Cameras.
    Cameras,
    /// Images without detections and marks.
    Images,
    /// Detections by image.
    Detections,
    /// Marks by image.
    Marks,
    /// Points by label.
    Points,
}

impl Table {
    /// All tables.
    pub(super) const ALL: [Table; 6] = [
        Table::Document,
        Table::Cameras,
        Table::Images,
        Table::Detections,
        Table::Marks,
        Table::Points,
    ];

    /// Its name in the file.
    pub(super) fn name(self) -> &'static str {
        match self {
            Table::Document => "document",
            Table::Cameras => "cameras",
            Table::Images => "images",
            Table::Detections => "detections",
            Table::Marks => "marks",
            Table::Points => "points",
        }
    }

    /// The statement that makes it. Rows with text ids live in the index itself: there is no second copy of the ids
    /// that could contradict the first.
    pub(super) fn definition(self) -> String {
        let name = self.name();
        let columns = "json TEXT NOT NULL, sha256 BLOB NOT NULL";
        match self {
            Table::Document | Table::Points => {
                format!(
                    "CREATE TABLE {name} (id TEXT PRIMARY KEY NOT NULL, {columns}) WITHOUT ROWID"
                )
            }
            _ => format!("CREATE TABLE {name} (id INTEGER PRIMARY KEY, {columns})"),
        }
    }
}

/// The id of a row.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum RowId {
    /// Of a camera or image.
    Number(u32),
    /// Of a point or a part of the document.
    Text(String),
}

impl fmt::Display for RowId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RowId::Number(number) => write!(f, "{number}"),
            RowId::Text(text) => f.write_str(text),
        }
    }
}

impl ToSql for RowId {
    fn to_sql(&self) -> rusqlite::Result<ToSqlOutput<'_>> {
        match self {
            RowId::Number(number) => number.to_sql(),
            RowId::Text(text) => text.to_sql(),
        }
    }
}

/// Which row.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    /// Its table.
    pub(super) table: Table,
    /// Its id there.
    pub(super) id: RowId,
}

/// A row as it is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Row {
    /// Where.
    pub(super) place: Place,
    /// What.
    pub(super) json: String,
}

/// SHA-256 of a row: table, id and JSON, so that a row in another's place is noticed too.
pub(super) fn checksum(place: &Place, json: &str) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(place.table.name());
    hash.update([0]);
    hash.update(place.id.to_string());
    hash.update([0]);
    hash.update(json);
    hash.finalize().into()
}

/// The names of an image's dots, apart from the image: moving a station leaves them alone.
#[derive(Clone, Debug, Default, PartialEq, Serialize, serde::Deserialize)]
pub(super) struct Marks {
    /// [`ImageEntry::labels`].
    pub(super) labels: Arc<BTreeMap<DotIndex, Label>>,
    /// [`ImageEntry::set_aside`].
    pub(super) set_aside: Arc<BTreeMap<usize, String>>,
    /// [`ImageEntry::unlabelled`].
    pub(super) unlabelled: Arc<BTreeMap<DotIndex, String>>,
}

impl Marks {
    /// The marks of an image.
    fn of(image: &ImageEntry) -> Self {
        Self {
            labels: image.labels.clone(),
            set_aside: image.set_aside.clone(),
            unlabelled: image.unlabelled.clone(),
        }
    }

    fn is_empty(&self) -> bool {
        self.labels.is_empty() && self.set_aside.is_empty() && self.unlabelled.is_empty()
    }

    fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.labels, &other.labels)
            && Arc::ptr_eq(&self.set_aside, &other.set_aside)
            && Arc::ptr_eq(&self.unlabelled, &other.unlabelled)
    }
}

/// What has to be written so that the file, which holds one network, holds another.
#[derive(Debug, Default)]
pub(super) struct Changes {
    /// Rows to insert or replace.
    pub(super) written: Vec<Row>,
    /// Rows to remove.
    pub(super) deleted: Vec<Place>,
}

impl Changes {
    /// From the `saved` network (`None`: from an empty file) to `network`.
    ///
    /// # Errors
    /// [`NotStorable`] for the first row that would not come back as it is.
    pub(super) fn between(saved: Option<&Network>, network: &Network) -> Result<Self, NotStorable> {
        let mut changes = Self::default();
        changes.document(saved, network)?;
        let empty = Network::default();
        let saved = saved.unwrap_or(&empty);
        if !Arc::ptr_eq(&saved.cameras, &network.cameras) {
            changes.compare(
                Table::Cameras,
                &saved.cameras,
                &network.cameras,
                |id| RowId::Number(id.0),
                |changes, place, _, camera| changes.write(place, camera.as_ref()),
            )?;
        }
        if !Arc::ptr_eq(&saved.points, &network.points) {
            changes.compare(
                Table::Points,
                &saved.points,
                &network.points,
                |id| RowId::Text(id.to_string()),
                |changes, place, _, point| changes.write(place, point.as_ref()),
            )?;
        }
        if !Arc::ptr_eq(&saved.images, &network.images) {
            changes.compare(
                Table::Images,
                &saved.images,
                &network.images,
                |id| RowId::Number(id.0),
                |changes, place, before, image| changes.image(place, before, image),
            )?;
        }
        Ok(changes)
    }

    /// Whether the file holds the network already.
    pub(super) fn is_empty(&self) -> bool {
        self.written.is_empty() && self.deleted.is_empty()
    }

    /// What there is once. A part that is added to the network does not compile until it is stored here.
    fn document(&mut self, saved: Option<&Network>, network: &Network) -> Result<(), NotStorable> {
        let Network {
            settings,
            cameras: _,
            images: _,
            points: _,
            names,
            device,
            scale_bars,
            control,
            frame,
            moved_by,
            connection_order,
            passes,
            tentative,
            ambiguous,
            conclusions,
            findings,
            adjustment,
            inputs,
            next_target,
        } = network;
        self.shared("settings", saved.map(|n| &n.settings), settings)?;
        self.shared("names", saved.map(|n| &n.names), names)?;
        self.shared("device", saved.map(|n| &n.device), device)?;
        self.shared("scale_bars", saved.map(|n| &n.scale_bars), scale_bars)?;
        self.shared("control", saved.map(|n| &n.control), control)?;
        self.plain("frame", saved.map(|n| &n.frame), frame)?;
        self.plain("moved_by", saved.map(|n| &n.moved_by), moved_by)?;
        let order = saved.map(|n| &n.connection_order);
        self.shared("connection_order", order, connection_order)?;
        self.shared("passes", saved.map(|n| &n.passes), passes)?;
        self.shared("tentative", saved.map(|n| &n.tentative), tentative)?;
        self.shared("ambiguous", saved.map(|n| &n.ambiguous), ambiguous)?;
        self.shared("findings", saved.map(|n| &n.findings), findings)?;
        self.plain("conclusions", saved.map(|n| &n.conclusions), conclusions)?;
        self.plain("inputs", saved.map(|n| &n.inputs), inputs)?;
        self.plain("next_target", saved.map(|n| &n.next_target), next_target)?;
        let before = saved.and_then(|n| n.adjustment.as_ref());
        match adjustment {
            Some(adjustment) => self.shared("adjustment", before, adjustment)?,
            None if before.is_some() => self.deleted.push(singleton("adjustment")),
            None => {}
        }
        Ok(())
    }

    /// A part of the document behind an `Arc`.
    fn shared<T: Stored>(
        &mut self,
        name: &str,
        saved: Option<&Arc<T>>,
        part: &Arc<T>,
    ) -> Result<(), NotStorable> {
        if saved.is_some_and(|saved| Arc::ptr_eq(saved, part)) {
            return Ok(());
        }
        self.write(singleton(name), part.as_ref())
    }

    /// A part of the document that is so small that it is compared itself.
    fn plain<T: Stored>(
        &mut self,
        name: &str,
        saved: Option<&T>,
        part: &T,
    ) -> Result<(), NotStorable> {
        if saved == Some(part) {
            return Ok(());
        }
        self.write(singleton(name), part)
    }

    /// Rows of one table whose `Arc` changed.
    fn compare<K: Ord, V>(
        &mut self,
        table: Table,
        saved: &BTreeMap<K, Arc<V>>,
        present: &BTreeMap<K, Arc<V>>,
        id: impl Fn(&K) -> RowId,
        change: impl Fn(&mut Self, Place, Option<&V>, &Arc<V>) -> Result<(), NotStorable>,
    ) -> Result<(), NotStorable> {
        for (key, value) in present {
            let before = saved.get(key);
            if !before.is_some_and(|before| Arc::ptr_eq(before, value)) {
                let place = Place { table, id: id(key) };
                change(self, place, before.map(Arc::as_ref), value)?;
            }
        }
        for key in saved.keys().filter(|key| !present.contains_key(key)) {
            let parts: &[Table] = match table {
                Table::Images => &[Table::Images, Table::Detections, Table::Marks],
                _ => &[table],
            };
            self.deleted
                .extend(parts.iter().map(|&table| Place { table, id: id(key) }));
        }
        Ok(())
    }

    /// The up to three rows of an image.
    fn image(
        &mut self,
        place: Place,
        before: Option<&ImageEntry>,
        image: &ImageEntry,
    ) -> Result<(), NotStorable> {
        let at = |table| Place {
            table,
            id: place.id.clone(),
        };
        let found = before.and_then(|i| i.detections.as_ref());
        match &image.detections {
            Some(detections) if found.is_some_and(|found| Arc::ptr_eq(found, detections)) => {}
            Some(detections) => self.write(at(Table::Detections), detections.as_ref())?,
            None if found.is_some() => self.deleted.push(at(Table::Detections)),
            None => {}
        }
        let marks = Marks::of(image);
        let marked = before.map(Marks::of).unwrap_or_default();
        if marks.is_empty() {
            if !marked.is_empty() {
                self.deleted.push(at(Table::Marks));
            }
        } else if !marks.is_same(&marked) {
            self.write(at(Table::Marks), &marks)?;
        }
        let bare = ImageEntry {
            detections: None,
            labels: Arc::default(),
            set_aside: Arc::default(),
            unlabelled: Arc::default(),
            ..image.clone()
        };
        self.write(place, &bare)
    }

    fn write<T: Stored>(&mut self, place: Place, value: &T) -> Result<(), NotStorable> {
        let json = encoded(&place, value)?;
        self.written.push(Row { place, json });
        Ok(())
    }
}

/// The place of a part of the document.
pub(super) fn singleton(name: &str) -> Place {
    Place {
        table: Table::Document,
        id: RowId::Text(name.to_owned()),
    }
}

/// What can be a row.
trait Stored: Serialize + DeserializeOwned + PartialEq + Debug {}

impl<T: Serialize + DeserializeOwned + PartialEq + Debug> Stored for T {}

/// The JSON of a value, read back to be sure of it: `serde_json` writes numbers that are not finite as `null`.
fn encoded<T: Stored>(place: &Place, value: &T) -> Result<String, NotStorable> {
    let refused = |reason| NotStorable {
        table: place.table.name(),
        id: place.id.to_string(),
        reason,
    };
    let json = serde_json::to_string(value).map_err(|error| refused(error.to_string()))?;
    let back = serde_json::from_str::<T>(&json);
    if back.as_ref().is_ok_and(|back| back == value) {
        return Ok(json);
    }
    Err(refused(match (not_finite(&format!("{value:?}")), back) {
        (Some(number), _) => format!("found a number that is not finite, {number}"),
        (None, Err(error)) => format!("it cannot be read back ({error})"),
        (None, Ok(_)) => "it is read back as something else".into(),
    }))
}

/// The first number in a `Debug` text that is not finite, with the field it stands in.
fn not_finite(debug: &str) -> Option<String> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let (start, number) = ["NaN", "-inf", "inf"]
        .into_iter()
        .filter_map(|number| {
            debug
                .match_indices(number)
                .map(|(at, _)| at)
                .find(|&at| {
                    !debug[..at].ends_with(is_name)
                        && !debug[at + number.len()..].starts_with(is_name)
                })
                .map(|at| (at, number))
        })
        .min_by_key(|(at, _)| *at)?;
    let field = debug[..start]
        .rmatch_indices(": ")
        .map(|(colon, _)| {
            let name = debug[..colon].rfind(|c| !is_name(c)).map_or(0, |at| at + 1);
            &debug[name..colon]
        })
        .find(|name| !name.is_empty());
    Some(match field {
        Some(field) => format!("{field}: {number}"),
        None => number.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_that_is_not_finite_is_named() {
        let text = |v: f64| {
            format!(
                "{:?}",
                crate::targets::Rejected {
                    place_px: nalgebra::Vector2::new(1.0, v),
                    reason: "information".into(),
                }
            )
        };
        assert_eq!(not_finite(&text(2.0)), None);
        assert_eq!(
            not_finite(&text(f64::NAN)).as_deref(),
            Some("place_px: NaN")
        );
        let infinite = not_finite(&text(f64::NEG_INFINITY));
        assert_eq!(infinite.as_deref(), Some("place_px: -inf"));
    }

    #[test]
    fn a_checksum_tells_rows_apart() {
        let at = |id| Place {
            table: Table::Images,
            id: RowId::Number(id),
        };
        assert_ne!(checksum(&at(1), "{}"), checksum(&at(2), "{}"));
        assert_ne!(checksum(&at(1), "{}"), checksum(&singleton("1"), "{}"));
    }
}
