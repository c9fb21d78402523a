//! Which panels there are and where they stand.

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

/// Image panels that stand side by side.
pub const IMAGE_PANELS: usize = 2;

/// The first layout: stages and images on the left, pictures in the middle, network and inspector on the right, lists
/// below.
#[must_use]
pub fn first_layout() -> Tree<Pane> {
    let mut tiles = Tiles::default();
    let mut pane = |pane| tiles.insert_pane(pane);
    let [stages, images] = [Pane::Stages, Pane::Images].map(&mut pane);
    let pictures: Vec<TileId> = (0..IMAGE_PANELS).map(|place| pane(Pane::Image(place))).collect();
    let [network, inspector] = [Pane::Network, Pane::Inspector].map(&mut pane);
    let lists = [Pane::Findings, Pane::Review, Pane::Tables, Pane::Plots, Pane::Journal].map(&mut pane);
    let left = shared(&mut tiles, LinearDir::Vertical, &[(stages, 0.4), (images, 0.6)]);
    let middle = shared(
        &mut tiles,
        LinearDir::Horizontal,
        &pictures.iter().map(|id| (*id, 1.0)).collect::<Vec<_>>(),
    );
    let right = shared(&mut tiles, LinearDir::Vertical, &[(network, 0.6), (inspector, 0.4)]);
    let top = shared(&mut tiles, LinearDir::Horizontal, &[(left, 0.2), (middle, 0.5), (right, 0.3)]);
    let below = tiles.insert_tab_tile(lists.to_vec());
    let root = shared(&mut tiles, LinearDir::Vertical, &[(top, 0.72), (below, 0.28)]);
    Tree::new(egui::Id::unique("tiepoint layout"), root, tiles)
}

fn shared(tiles: &mut Tiles<Pane>, direction: LinearDir, parts: &[(TileId, f32)]) -> TileId {
    let mut linear = Linear::new(direction, parts.iter().map(|(id, _)| *id).collect());
    for (id, share) in parts {
        linear.shares.set_share(*id, *share);
    }
    tiles.insert_new(Tile::Container(Container::Linear(linear)))
}
