//! Selects the channels that contain the colours of a part.

use super::header::{Channel, PartHeader, Sample};
use crate::image::Precision;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Selection {
    /// For each channel of the part, the indices of the pixel's components (0 to 3 for R, G, B, A) that the channel
    /// fills.
    pub(super) fills: Vec<&'static [usize]>,
    pub(super) precision: Precision,
    /// `true` if the selected channels are R, G and B, `false` if the selected channel is the grey channel Y.
    pub(super) coloured: bool,
}

/// Selects the channels of one layer: the first layer with colours, or else the first layer with greys. The layer
/// without a name counts as the first layer of the file. `None` if no layer has colours or greys.
pub(super) fn select(part: &PartHeader) -> Option<Selection> {
    let layers = || {
        let names = part.channels.iter().map(|channel| split(channel).0);
        std::iter::once("").chain(names.filter(|layer| !layer.is_empty()))
    };
    let pick = |wanted: &dyn Fn(&str) -> bool| layers().find(|layer| wanted(layer));
    let has = |layer: &str, name: &str| {
        part.channels.iter().any(|channel| split(channel) == (layer, name))
    };
    let coloured = |layer: &str| ["R", "G", "B"].iter().all(|name| has(layer, name));
    // Channels X, Y and Z contain a vector. Channels Y, RY and BY contain colours in another encoding.
    let grey =
        |layer: &str| has(layer, "Y") && !["X", "Z", "RY", "BY"].iter().any(|n| has(layer, n));
    let (layer, coloured) = pick(&coloured)
        .map(|layer| (layer, true))
        .or_else(|| pick(&grey).map(|layer| (layer, false)))?;
    let fills: Vec<&'static [usize]> = part
        .channels
        .iter()
        .map(|channel| match split(channel) {
            (of, name) if of == layer => match name {
                "R" if coloured => &[0][..],
                "G" if coloured => &[1],
                "B" if coloured => &[2],
                "Y" if !coloured => &[0, 1, 2],
                "A" => &[3],
                _ => &[],
            },
            _ => &[],
        })
        .collect();
    let half = fills
        .iter()
        .zip(&part.channels)
        .all(|(fills, channel)| fills.is_empty() || channel.sample == Sample::Half);
    let precision = if half { Precision::Half } else { Precision::Float };
    Some(Selection { fills, precision, coloured })
}

/// The name of a channel's layer, and the channel's name in this layer.
fn split(channel: &Channel) -> (&str, &str) {
    channel.name.rsplit_once('.').unwrap_or(("", &channel.name))
}
