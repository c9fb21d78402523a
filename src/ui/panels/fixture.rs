//! What the tests of panels draw: the small network of the reports, with findings and doubts.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;

use egui::Ui;
use egui_kittest::Harness;

use crate::imaging::GreyImage;
use crate::network::{About, Finding, FindingKind, ImageId, Network, Stage};
use crate::ui::action::{Action, Selection};
use crate::ui::context::ViewContext;
use crate::ui::pictures::{PictureSettings, PictureStore};

/// The network of the reports with a finding from each of three stages.
pub(super) fn network() -> Network {
    let mut network = crate::report::fixture::network();
    let finding = |stage, kind, about, text: &str| Finding {
        stage,
        kind,
        about,
        text: text.into(),
    };
    network.findings = Arc::new(vec![
        finding(
            Stage::Detect,
            FindingKind::Camera,
            About::Project,
            "the images name no camera",
        ),
        finding(
            Stage::Connect,
            FindingKind::UnconnectedImage,
            About::Image(ImageId(2)),
            "img_2.png: too few codes",
        ),
        finding(
            Stage::Adjust,
            FindingKind::RejectedObservation,
            About::Point("M1".parse().unwrap()),
            "M1: 1 of 3 observations is rejected",
        ),
    ]);
    network
}

/// Network and selection that a panel is drawn with.
struct Shown {
    network: Network,
    selection: Selection,
    actions: Vec<Action>,
}

/// A panel in a harness, and what it asked for.
pub(super) struct Bench {
    /// The harness.
    pub(super) harness: Harness<'static>,
    shown: Rc<RefCell<Shown>>,
}

impl Bench {
    /// Draws a panel once.
    pub(super) fn new(
        network: Network,
        panel: impl FnMut(&mut Ui, &ViewContext<'_>, &mut Vec<Action>) + 'static,
    ) -> Self {
        Self::selecting(network, Selection::default(), panel)
    }

    /// Draws a panel once with something selected.
    pub(super) fn selecting(
        network: Network,
        selection: Selection,
        panel: impl FnMut(&mut Ui, &ViewContext<'_>, &mut Vec<Action>) + 'static,
    ) -> Self {
        Self::with_pictures(network, selection, BTreeMap::new(), panel)
    }

    /// Draws a panel once with pictures that are there.
    pub(super) fn with_pictures(
        network: Network,
        selection: Selection,
        there: BTreeMap<ImageId, Arc<GreyImage>>,
        mut panel: impl FnMut(&mut Ui, &ViewContext<'_>, &mut Vec<Action>) + 'static,
    ) -> Self {
        let mut pictures = PictureStore::new(PictureSettings::default(), || ()).expect("a thread");
        for (id, picture) in there {
            pictures.insert(id, &network.images[&id], picture);
        }
        let shown = Rc::new(RefCell::new(Shown {
            network,
            selection,
            actions: Vec::new(),
        }));
        let inside = shown.clone();
        let group = std::sync::Arc::default();
        let harness = Harness::builder()
            .with_size([900.0, 600.0])
            .build_ui(move |ui| {
                let shown = &mut *inside.borrow_mut();
                let context = ViewContext {
                    group: &group,
                    network: &shown.network,
                    pictures: &pictures,
                    selection: &shown.selection,
                    pending: &[],
                };
                panel(ui, &context, &mut shown.actions);
            });
        Self { harness, shown }
    }

    /// Draws until nothing moves, and gives what was asked for since the last time.
    pub(super) fn actions(&mut self) -> Vec<Action> {
        self.harness.run();
        std::mem::take(&mut self.shown.borrow_mut().actions)
    }

    /// Selects something.
    pub(super) fn select(&mut self, selection: Selection) {
        self.shown.borrow_mut().selection = selection;
        self.harness.run();
    }

    /// Changes the network under the panel.
    pub(super) fn change(&mut self, change: impl FnOnce(&mut Network)) {
        change(&mut self.shown.borrow_mut().network);
        self.harness.run();
    }
}
