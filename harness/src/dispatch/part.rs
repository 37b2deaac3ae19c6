//! Selects parts of resources. For example, `particles.position` selects the member `position` of each element
//! of `particles`.

use crate::value::Shape;

/// A part of a resource: all its components, or the components of a member.
#[derive(Clone, Debug)]
pub struct Part {
    /// The index of the resource in [`Passes::resources`](super::Passes::resources).
    pub number: usize,
    /// The indices of the selected components. `None` selects all components.
    lanes: Option<Vec<usize>>,
}

impl Part {
    /// Selects a member of a resource by its path in the resource's type, such as
    /// `position` or `items.position.x`. An empty path selects the whole resource.
    pub(crate) fn of(number: usize, shape: &Shape, path: &str) -> Option<(Self, Shape)> {
        if path.is_empty() {
            return Some((Self { number, lanes: None }, shape.clone()));
        }
        let (shape, lanes) = picked(shape, path)?;
        Some((Self { number, lanes: Some(lanes) }, shape))
    }

    /// Picks the values of this part. `all` has one value for each component of the resource.
    pub(crate) fn pick<T: Copy>(&self, all: Vec<T>) -> Vec<T> {
        match &self.lanes {
            Some(lanes) => lanes.iter().map(|lane| all[*lane]).collect(),
            None => all,
        }
    }
}

/// Finds the type and the component indices of a member. In an array, the path selects the member of every
/// element, or of one element by its index (`[1].at`).
fn picked(shape: &Shape, path: &str) -> Option<(Shape, Vec<usize>)> {
    if path.is_empty() {
        return Some((shape.clone(), (0..shape.lanes().len()).collect()));
    }
    if let Some((index, rest)) = path.strip_prefix('[').and_then(|path| path.split_once(']')) {
        let (element, count) = match shape {
            Shape::Array { element, length } => (Shape::clone(element), *length),
            Shape::Matrix { columns, rows, scalar } => {
                (Shape::Vector { size: *rows, scalar: *scalar }, u32::from(*columns))
            }
            Shape::Vector { size, scalar } => (Shape::Scalar(*scalar), u32::from(*size)),
            _ => return None,
        };
        let index = index.parse::<u32>().ok().filter(|index| *index < count)? as usize;
        let width = element.lanes().len();
        let (shape, lanes) = picked(&element, rest.strip_prefix('.').unwrap_or(rest))?;
        return Some((shape, lanes.into_iter().map(|lane| index * width + lane).collect()));
    }
    let (name, rest) = path.split_at(path.find(['.', '[']).unwrap_or(path.len()));
    let rest = rest.strip_prefix('.').unwrap_or(rest);
    match shape {
        Shape::Array { element, length } => {
            let width = element.lanes().len();
            let (element, lanes) = picked(element, path)?;
            let of = |index: usize| lanes.iter().map(move |lane| index * width + lane);
            let all = (0..*length as usize).flat_map(of).collect();
            Some((Shape::Array { element: Box::new(element), length: *length }, all))
        }
        Shape::Struct { members, .. } => {
            let at = members.iter().position(|(own, _)| own == name)?;
            let before: usize = members[..at].iter().map(|(_, shape)| shape.lanes().len()).sum();
            let (shape, lanes) = picked(&members[at].1, rest)?;
            Some((shape, lanes.into_iter().map(|lane| before + lane).collect()))
        }
        Shape::Vector { size, scalar } if rest.is_empty() => {
            let lane = ["x", "y", "z", "w"].iter().position(|own| *own == name)?;
            (lane < usize::from(*size)).then(|| (Shape::Scalar(*scalar), vec![lane]))
        }
        _ => None,
    }
}

/// Splits a name into the name of a resource and the path of a member. If the name ends with a dot, the path is `.`,
/// which matches no member.
pub(crate) fn split(name: &str) -> (&str, &str) {
    match name.split_once('.') {
        Some((resource, "")) => (resource, "."),
        other => other.unwrap_or((name, "")),
    }
}

/// The members with which a path can begin.
pub(crate) fn members(shape: &Shape) -> Vec<String> {
    match shape {
        Shape::Array { element, .. } => members(element),
        Shape::Struct { members, .. } => members.iter().map(|(name, _)| name.clone()).collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::Scalar;

    #[test]
    fn a_path_selects_one_member_of_each_element() {
        let vector = Shape::Vector { size: 3, scalar: Scalar::F32 };
        let item = Shape::Struct {
            name: "Item".to_owned(),
            members: vec![
                ("mass".to_owned(), Shape::Scalar(Scalar::F32)),
                ("at".to_owned(), vector.clone()),
            ],
        };
        let items = Shape::Array { element: Box::new(item), length: 2 };
        let whole = Shape::Struct {
            name: "All".to_owned(),
            members: vec![
                ("count".to_owned(), Shape::Scalar(Scalar::U32)),
                ("items".to_owned(), items.clone()),
            ],
        };
        let lanes = |shape: &Shape, path: &str| {
            Part::of(0, shape, path).map(|(part, shape)| (part.pick((0..9).collect()), shape))
        };
        let vectors = Shape::Array { element: Box::new(vector), length: 2 };
        assert_eq!(lanes(&items, "at"), Some((vec![1, 2, 3, 5, 6, 7], vectors.clone())));
        assert_eq!(lanes(&whole, "items.at"), Some((vec![2, 3, 4, 6, 7, 8], vectors)));
        assert_eq!(lanes(&whole, "items.at.y").map(|(lanes, _)| lanes), Some(vec![3, 7]));
        assert_eq!(lanes(&whole, "count").map(|(lanes, _)| lanes), Some(vec![0]));
        assert_eq!(lanes(&whole, "").map(|(lanes, _)| lanes.len()), Some(9));
        assert_eq!(lanes(&whole, "items[1].at.y").map(|(lanes, _)| lanes), Some(vec![7]));
        assert_eq!(lanes(&items, "[1].mass").map(|(lanes, _)| lanes), Some(vec![4]));
        assert_eq!(lanes(&whole, "items[0]").map(|(lanes, _)| lanes), Some(vec![1, 2, 3, 4]));
        for wrong in [
            "items[2]",
            "items[x]",
            "items[",
            "count[0]",
            "items[0]at[9]",
            "at",
            "items.to",
            "items.at.w",
            "items.at.x.y",
            "count.x",
        ] {
            assert_eq!(lanes(&whole, wrong), None, "{wrong}");
        }
        assert_eq!(members(&items), ["mass", "at"]);
    }
}
