//! What is drawn belongs to one state of the network; it is computed again when that state is another.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::network::{
    AdjustmentResult, CameraEntry, CameraId, Finding, ImageEntry, ImageId, MeasurementSettings,
    Network, Point, PointId, ScaleBar,
};

/// The parts of a network that panels draw from; holding them keeps their addresses from being used again.
struct Basis {
    settings: Arc<MeasurementSettings>,
    cameras: Arc<BTreeMap<CameraId, Arc<CameraEntry>>>,
    images: Arc<BTreeMap<ImageId, Arc<ImageEntry>>>,
    points: Arc<BTreeMap<PointId, Arc<Point>>>,
    names: Arc<BTreeMap<u32, String>>,
    scale_bars: Arc<Vec<ScaleBar>>,
    findings: Arc<Vec<Finding>>,
    adjustment: Option<Arc<AdjustmentResult>>,
}

/// Whether both are the same value, not only equal ones.
pub(super) fn is_same<T>(a: &Option<Arc<T>>, b: &Option<Arc<T>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (None, None) => true,
        _ => false,
    }
}

impl Basis {
    fn of(network: &Network) -> Self {
        Self {
            settings: network.settings.clone(),
            cameras: network.cameras.clone(),
            images: network.images.clone(),
            points: network.points.clone(),
            names: network.names.clone(),
            scale_bars: network.scale_bars.clone(),
            findings: network.findings.clone(),
            adjustment: network.adjustment.clone(),
        }
    }

    fn holds(&self, network: &Network) -> bool {
        is_same(&self.adjustment, &network.adjustment)
            && Arc::ptr_eq(&self.settings, &network.settings)
            && Arc::ptr_eq(&self.cameras, &network.cameras)
            && Arc::ptr_eq(&self.images, &network.images)
            && Arc::ptr_eq(&self.points, &network.points)
            && Arc::ptr_eq(&self.names, &network.names)
            && Arc::ptr_eq(&self.scale_bars, &network.scale_bars)
            && Arc::ptr_eq(&self.findings, &network.findings)
    }
}

struct Entry<K, T> {
    basis: Basis,
    key: K,
    value: T,
}

/// A value computed from the network and a key; kept while both stay the same.
pub(super) struct Cached<K, T> {
    entry: Option<Entry<K, T>>,
}

impl<K, T> Default for Cached<K, T> {
    fn default() -> Self {
        Self { entry: None }
    }
}

impl<K: PartialEq, T> Cached<K, T> {
    /// The value; `build` is called only where network or key are others than the last time.
    pub(super) fn get(&mut self, network: &Network, key: K, build: impl FnOnce(&K) -> T) -> &mut T {
        let kept = self
            .entry
            .as_ref()
            .is_some_and(|e| e.key == key && e.basis.holds(network));
        if !kept {
            self.entry = None;
        }
        let entry = self.entry.get_or_insert_with(|| Entry {
            basis: Basis::of(network),
            value: build(&key),
            key,
        });
        &mut entry.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_built_once_for_each_state_and_key() {
        let mut network = Network::default();
        let mut cached = Cached::default();
        let mut built = 0;
        let mut ask = |network: &Network, key: u32| {
            cached.get(network, key, |key| {
                built += 1;
                *key
            });
            built
        };
        assert_eq!(ask(&network, 1), 1);
        assert_eq!(ask(&network, 1), 1);
        assert_eq!(ask(&network.clone(), 1), 1);
        assert_eq!(ask(&network, 2), 2);
        network.points = Arc::new(BTreeMap::new());
        assert_eq!(ask(&network, 2), 3);
        network.names = Arc::new(BTreeMap::from([(1, "edge".to_owned())]));
        assert_eq!(ask(&network, 2), 4, "a target has another name");
    }
}
