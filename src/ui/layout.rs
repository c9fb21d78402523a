//! Which panels there are and where they stand.

use egui::Key;
use egui_tiles::{Container, Linear, LinearDir, Tile, TileId, Tiles, Tree};

/// A panel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pane {
    /// The six stages.
    Stages,
    /// The image list.
    Images,
    /// An image, by its place among the image panels.
    Image(usize),
    /// The network in 3D.
    Network,
    /// What is selected.
    Inspector,
    /// The coordinate system of the result.
    Frame,
    /// Findings.
    Findings,
    /// The review queue.
    Review,
    /// Tables.
    Tables,
    /// Plots.
    Plots,
    /// The history.
    Journal,
}

impl Pane {
    /// Its name.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Pane::Stages => "Stages",
            Pane::Images => "Images",
            Pane::Image(_) => "Image",
            Pane::Network => "Network",
            Pane::Inspector => "Inspector",
            Pane::Frame => "Frame",
            Pane::Findings => "Findings",
            Pane::Review => "Review",
            Pane::Tables => "Tables",
            Pane::Plots => "Plots",
            Pane::Journal => "History",
        }
    }

    /// Name of the command that brings it to the front.
    #[must_use]
    pub fn command(self) -> &'static str {
        match self {
            Pane::Stages => "Show stages",
            Pane::Images => "Show images",
            Pane::Image(_) => "Show image",
            Pane::Network => "Show network",
            Pane::Inspector => "Show inspector",
            Pane::Frame => "Show frame",
            Pane::Findings => "Show findings",
            Pane::Review => "Show review",
            Pane::Tables => "Show tables",
            Pane::Plots => "Show plots",
            Pane::Journal => "Show history",
        }
    }

    /// The key that, with Alt, brings it to the front.
    #[must_use]
    pub fn key(self) -> Option<Key> {
        match self {
            Pane::Stages => Some(Key::S),
            Pane::Images => Some(Key::I),
            Pane::Image(_) => None,
            Pane::Network => Some(Key::W),
            Pane::Inspector => Some(Key::O),
            Pane::Frame => Some(Key::A),
            Pane::Findings => Some(Key::Num1),
            Pane::Review => Some(Key::Num2),
            Pane::Tables => Some(Key::Num3),
            Pane::Plots => Some(Key::Num4),
            Pane::Journal => Some(Key::Num5),
        }
    }
}

/// The first layout: stages and images on the left, pictures in the middle, network and inspector on the right, lists
/// below.
#[must_use]
pub fn first_layout(image_panels: usize) -> Tree<Pane> {
    let mut tiles = Tiles::default();
    let mut pane = |pane| tiles.insert_pane(pane);
    let [stages, images] = [Pane::Stages, Pane::Images].map(&mut pane);
    let pictures: Vec<TileId> = (0..image_panels)
        .map(|place| pane(Pane::Image(place)))
        .collect();
    let network = pane(Pane::Network);
    let beside = [Pane::Inspector, Pane::Frame].map(&mut pane);
    let lists = [
        Pane::Findings,
        Pane::Review,
        Pane::Tables,
        Pane::Plots,
        Pane::Journal,
    ]
    .map(&mut pane);
    let left = shared(
        &mut tiles,
        LinearDir::Vertical,
        &[(stages, 0.45), (images, 0.55)],
    );
    let middle = grid(&mut tiles, &pictures);
    let beside = tiles.insert_tab_tile(beside.to_vec());
    let right = shared(
        &mut tiles,
        LinearDir::Vertical,
        &[(network, 0.6), (beside, 0.4)],
    );
    let top = shared(
        &mut tiles,
        LinearDir::Horizontal,
        &[(left, 0.2), (middle, 0.5), (right, 0.3)],
    );
    let below = tiles.insert_tab_tile(lists.to_vec());
    let root = shared(
        &mut tiles,
        LinearDir::Vertical,
        &[(top, 0.72), (below, 0.28)],
    );
    Tree::new(egui::Id::unique("tiepoint layout"), root, tiles)
}

/// Pictures in rows of two.
fn grid(tiles: &mut Tiles<Pane>, pictures: &[TileId]) -> TileId {
    let equal = |ids: &[TileId]| ids.iter().map(|id| (*id, 1.0)).collect::<Vec<_>>();
    let rows: Vec<TileId> = (pictures.chunks(2))
        .map(|row| shared(tiles, LinearDir::Horizontal, &equal(row)))
        .collect();
    shared(tiles, LinearDir::Vertical, &equal(&rows))
}

fn shared(tiles: &mut Tiles<Pane>, direction: LinearDir, parts: &[(TileId, f32)]) -> TileId {
    let mut linear = Linear::new(direction, parts.iter().map(|(id, _)| *id).collect());
    for (id, share) in parts {
        linear.shares.set_share(*id, *share);
    }
    tiles.insert_new(Tile::Container(Container::Linear(linear)))
}
