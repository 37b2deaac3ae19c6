//! Searches for arguments with a result that reaches an excluded value, such as the end of a half-open range.
//! The search begins at the cases with results nearest to that value.

use std::collections::HashSet;

use super::Failure;
use super::batch::SEARCHED;
use super::goal::{Distance, Goal};
use super::session::Session;
use crate::probe::Inputs;
use crate::value::Scalar;

/// The largest number of cases that a search examines first. Each round of the search begins at the `FOLLOWED` rows of
/// arguments with results nearest to the excluded value.
const LOOKED_AT: u64 = 4096;
const FOLLOWED: usize = 8;

/// The largest number of rounds in a search. The search also ends after more than `PATIENCE` rounds without a
/// nearer result.
const ROUNDS: usize = 24;
const PATIENCE: usize = 3;

/// The largest number of rounds in which Karat simplifies the arguments that the search found.
const SIMPLER: usize = 64;

impl Session<'_> {
    /// Returns the simplest failing arguments that the search finds. `None` if the search finds no failing arguments,
    /// or if Karat can't check whether the domain contains given arguments.
    pub(super) fn search(&self, goal: &Goal<'_>) -> Result<Option<Vec<u32>>, Failure> {
        let width = self.stream.width();
        let Some(distance) = goal.distance else { return Ok(None) };
        // With constants as arguments, Karat must compile a kernel for each batch. That takes too long.
        let is_compiled = self.inputs == Inputs::Constant;
        if width == 0 || is_compiled || self.is_replay() || self.input().is_some() {
            return Ok(None);
        }
        let goal = (distance, goal);
        let few = self.count().min(LOOKED_AT).min(self.called.capacity() as u64);
        let drawn = self.draw(0, few)?;
        let rows: Vec<Vec<u32>> = drawn.rows().iter().map(<[u32]>::to_vec).collect();
        let mut known: HashSet<Vec<u32>> = rows.iter().cloned().collect();
        let mut near = match self.tried(&rows, goal)? {
            Ok(failing) => return self.simplified(failing, goal).map(Some),
            Err(near) => near,
        };
        let mut without = 0;
        for _ in 0..ROUNDS {
            let least = near.first().map_or(f64::INFINITY, |(distance, _)| *distance);
            let mut candidates = Vec::new();
            for neighbour in near.iter().flat_map(|(_, row)| self.neighbours(row)) {
                if self.stream.admits(&neighbour) == Some(true) && known.insert(neighbour.clone()) {
                    candidates.push(neighbour);
                }
            }
            candidates.truncate(self.called.capacity());
            if candidates.is_empty() {
                break;
            }
            match self.tried(&candidates, goal)? {
                Ok(failing) => return self.simplified(failing, goal).map(Some),
                Err(others) => near.extend(others),
            }
            near.sort_by(|(one, _), (other, _)| one.total_cmp(other));
            near.truncate(FOLLOWED);
            let is_nearer = near.first().is_some_and(|(distance, _)| *distance < least);
            without = if is_nearer { 0 } else { without + 1 };
            if without > PATIENCE {
                break;
            }
        }
        Ok(None)
    }

    /// Calls the function with some rows of arguments. Returns the first failing row, or else the rows with
    /// results nearest to the excluded value.
    #[expect(clippy::type_complexity, reason = "rows with their distances")]
    fn tried(
        &self,
        rows: &[Vec<u32>],
        (distance, goal): (Distance<'_>, &Goal<'_>),
    ) -> Result<Result<Vec<u32>, Vec<(f64, Vec<u32>)>>, Failure> {
        let batch = self.batch(SEARCHED, rows.concat(), rows.len());
        let results = self.results(&batch, &batch.lanes())?;
        let mut near = Vec::new();
        for (case, row) in rows.iter().enumerate() {
            let result = results.of(case);
            if (goal.fails)(batch.arguments(case), result) {
                return Ok(Ok(row.clone()));
            }
            near.push((distance(result), row.clone()));
        }
        near.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        near.truncate(FOLLOWED);
        Ok(Err(near))
    }

    /// Returns rows that differ from `row` in one number. An integer changes by 1 or 16. For floats, see `of_float`.
    fn neighbours(&self, row: &[u32]) -> Vec<Vec<u32>> {
        let mut all = Vec::new();
        for (lane, scalar) in self.called.argument_scalars().iter().enumerate().take(row.len()) {
            let words = match scalar {
                Scalar::F32 => {
                    of_float(f32::from_bits(row[lane])).into_iter().map(f32::to_bits).collect()
                }
                Scalar::I32 | Scalar::U32 => [1, 16]
                    .iter()
                    .flat_map(|by| [row[lane].wrapping_add(*by), row[lane].wrapping_sub(*by)])
                    .collect(),
                Scalar::Bool | Scalar::F16 => Vec::new(),
            };
            for word in words {
                let mut neighbour = row.to_vec();
                neighbour[lane] = word;
                all.push(neighbour);
            }
        }
        all
    }

    /// Simplifies failing arguments as long as the simpler arguments also fail.
    fn simplified(
        &self,
        row: Vec<u32>,
        goal: (Distance<'_>, &Goal<'_>),
    ) -> Result<Vec<u32>, Failure> {
        let mut row = row;
        for _ in 0..SIMPLER {
            let mut simpler = self.stream.shrink(&row);
            simpler.truncate(self.called.capacity());
            if simpler.is_empty() {
                break;
            }
            match self.tried(&simpler, goal)? {
                Ok(failing) => row = failing,
                Err(_) => break,
            }
        }
        Ok(row)
    }
}

/// Returns numbers to try instead of `x`: `-x`, fractions of `x`, numbers from 1 to 2^20 ulp away, and the nearest
/// integer with its neighbours. Also returns tiny numbers, such as 2^-30, because `1.0 + tiny` rounds to 1.0.
fn of_float(x: f32) -> Vec<f32> {
    const SMALL: f32 = 1.0 / 1_073_741_824.0; // 2^-30
    const ULPS: [i32; 6] = [1, 16, 256, 4096, 65_536, 1 << 20];
    let nearest = x.round();
    let towards = |by: f32| nearest + (x - nearest) * by;
    let by_ulps = |by: i32| {
        let bits = x.to_bits().cast_signed();
        f32::from_bits(bits.saturating_add(by).cast_unsigned())
    };
    let scaled = [x / 2.0, x / 16.0, x / 65_536.0 /* 2^16 */, x * 2.0, -x];
    let small = [SMALL, -SMALL, SMALL * SMALL, -SMALL * SMALL];
    let whole =
        [nearest, nearest.next_up(), nearest.next_down(), towards(0.5), towards(1.0 / 256.0)];
    let moved = ULPS.into_iter().flat_map(|by| [by_ulps(by), by_ulps(-by)]);
    let all = scaled.into_iter().chain(small).chain(whole).chain(moved);
    // A range that begins at 0 also contains -0, but Karat never samples -0 from such a range.
    all.map(|x| if x == 0.0 { 0.0 } else { x }).collect()
}
