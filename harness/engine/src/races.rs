//! Races: accesses of one element by two invocations, one of which writes, and which nothing orders.
//!
//! WGSL orders little (its specification, 15.4 *Memory model* and 17.11 *Synchronization built-in functions*). A
//! barrier orders the invocations of its workgroup, and the address spaces that its name says. Nothing orders two
//! workgroups of a dispatch. Atomic accesses don't race with each other, and WGSL has no other access of an atomic.
//!
//! The machine runs invocations in lockstep, so a race shows in no result. Instead each element remembers accesses that a
//! later one could race with:
//!
//! - the last write, and the last one by another invocation. If a write of this epoch isn't by the invocation that
//!   accesses now, one of these two isn't;
//! - the last write by an earlier workgroup;
//! - the last write of another word, which tells equal writes from others;
//! - two reads of different invocations since the last barrier, and one by an earlier workgroup.

use std::collections::{BTreeMap, HashMap, HashSet};

use naga::Barrier;

use crate::code::{Binding, Code, Site};
use crate::dispatch::Turn;
use crate::explore::{Access as Touch, Word};
use crate::refusal::Stop;

/// Bytes, or texels, whose elements are remembered together. Most of a large buffer may never be accessed.
const PAGE: usize = 1024;

/// Elements that one dispatch remembers, in 116 bytes each: 116 MiB. Accesses of others are counted.
const MOST_CELLS: usize = 1 << 20;
const _: () = assert!(size_of::<Cell>() == 116);

/// Races that are kept of a variable, each of another pair of lines: equal writes, and others. A loop over a buffer
/// has one for each of its elements, by the same lines.
const MOST_RACES: usize = 64;

/// No invocation.
const NONE: u32 = u32::MAX;

/// The place of an element, which is a scalar, in its variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The byte at which it begins in its variable.
    Byte(u32),
    /// The texel.
    Texel([u32; 3]),
}

/// An access of an element.
#[derive(Clone, Debug)]
pub struct Access {
    /// Where the author wrote it.
    pub site: Site,
    /// The invocation, counted over all of the dispatch: workgroup after workgroup, and in a workgroup by
    /// `local_invocation_index`.
    pub invocation: usize,
    /// `true` for a write.
    pub writes: bool,
    /// The word that it writes or reads.
    pub word: u32,
    /// Of a texel its channels, as far as they are kept.
    pub texel: Option<[u32; 4]>,
}

/// Two accesses of an element that nothing orders.
#[derive(Clone, Debug)]
pub struct Race {
    /// The variable's name in the module.
    pub variable: String,
    /// The variable's group and binding; `None` of a variable in workgroup memory.
    pub binding: Option<(u32, u32)>,
    /// The element.
    pub place: Place,
    /// The access that came first in the machine's order.
    pub first: Access,
    /// The other one.
    pub second: Access,
    /// `true` if their invocations are in one workgroup, so that a barrier could order them.
    pub one_workgroup: bool,
    /// How many elements have a race of these two accesses, this one included.
    pub elements: u64,
}

impl Race {
    /// Returns `true` if both write, and write the same.
    #[must_use]
    pub fn writes_equally(&self) -> bool {
        self.first.writes && self.second.writes && self.first.word == self.second.word
    }
}

/// A barrier that some invocations of a workgroup didn't reach together, or a subgroup operation that some of a
/// subgroup didn't.
#[derive(Clone, Debug)]
pub struct Divergence {
    /// The barrier.
    pub site: Site,
    /// An invocation that reached it.
    pub reached: usize,
    /// The first that didn't.
    pub missing: usize,
    /// How many didn't.
    pub count: usize,
    /// `true` for a subgroup operation.
    pub subgroup: bool,
    /// The condition, or the jump, where that one went another way; `None` if it never came to a part of the code that
    /// leads to the barrier.
    pub parted: Option<Site>,
}

/// Reads of an element that nothing has written: of workgroup memory, which WGSL begins at zero, or of a blank buffer.
#[derive(Clone, Debug)]
pub struct Unwritten {
    /// The first of these reads.
    pub access: Access,
    /// The variable's name in the module.
    pub variable: String,
    /// `true` for workgroup memory.
    pub own: bool,
    /// The byte at which the first element begins in its variable.
    pub byte: u32,
    /// How many reads by the same line are of such an element.
    pub count: u64,
}

/// The kind of what an index leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Bounds {
    /// An array whose length the program says.
    Fixed,
    /// An array as long as its buffer.
    Runtime,
    /// A texture.
    Texture,
    /// A subgroup: there is no such invocation, or it isn't active.
    Subgroup,
    /// Nothing: it is one of the array, but only because a sum or a product has wrapped around.
    Wrapped,
}

/// Indices of an operation that leave their array.
#[derive(Clone, Debug)]
pub struct Outside {
    /// The operation.
    pub site: Site,
    /// The first invocation of which it is so.
    pub invocation: usize,
    /// How often it is so.
    pub count: u64,
    /// `true` for a write or an atomic.
    pub writes: bool,
    /// The kind of what it leaves.
    pub bounds: Bounds,
    /// The buffer, the workgroup's variable or the texture that the array is or is in; `None`: a variable of the invocation.
    pub variable: Option<String>,
    /// `true` for an array within others, or within a structure.
    pub nested: bool,
    /// The index of that invocation, and the elements of the array, if it is in a buffer; of an index that wraps the
    /// number that it is without an end, and the one that it is.
    pub index: Option<(i64, u64)>,
    /// How often the operation ran.
    pub of: u64,
    /// The number by which [`Options::outside_at`](crate::Options::outside_at) names the operation.
    pub number: u32,
}

/// An index of an operation that leaves its array.
#[derive(Clone, Copy)]
pub(crate) struct Beyond<'c> {
    pub(crate) writes: bool,
    pub(crate) bounds: Bounds,
    pub(crate) variable: Option<&'c str>,
    pub(crate) nested: bool,
    pub(crate) index: Option<(i64, u64)>,
}

/// The findings of a dispatch.
#[derive(Clone, Debug, Default)]
pub struct Observed {
    /// Races, of each pair of accesses the first; reads and writes before equal writes.
    pub races: Vec<Race>,
    /// Barriers that weren't reached by all, each once.
    pub divergences: Vec<Divergence>,
    /// Operations whose indices leave their arrays or textures, each once.
    pub outside: Vec<Outside>,
    /// Reads of workgroup memory, and of blank buffers, before they are written, each line once.
    pub unwritten: Vec<Unwritten>,
    /// Of storage buffers and storage textures that the program may write, by group and binding: which of their words, or
    /// texels, it wrote.
    pub written: BTreeMap<(u32, u32), Touched>,
    /// Why the dispatch ended before all of it had run.
    pub stopped: Option<Stop>,
    /// Invocations that ran.
    pub invocations: usize,
    /// Rounds of loops, of all of them together.
    pub rounds: u64,
    /// Turns that its invocations had.
    pub turns: u64,
    /// Its atomics.
    pub atomics: Atomics,
    /// The order of the atomics, if it was asked for.
    pub order: Vec<Turn>,
    /// Accesses of elements beyond those that are remembered.
    pub unwatched: u64,
}

/// The atomics of a dispatch, as far as the number of their orders depends on them.
#[derive(Clone, Debug, Default)]
pub struct Atomics {
    /// How many each invocation has, by its number.
    pub of_invocation: Vec<u32>,
    /// Those of each word: their kinds as bits, and how many the invocations have.
    words: HashMap<Word, (u32, BTreeMap<usize, u32>)>,
    count: usize,
}

impl Atomics {
    /// Atomics whose orders are counted: of more there are too many to try each.
    const COUNTED: usize = 1 << 12;

    fn add(&mut self, invocation: usize, word: Word, kind: Touch) {
        if self.of_invocation.len() <= invocation {
            self.of_invocation.resize(invocation + 1, 0);
        }
        self.of_invocation[invocation] += 1;
        self.count += 1;
        let (kinds, counts) = self.words.entry(word).or_default();
        *kinds |= 1 << kind as u32;
        if self.count <= Self::COUNTED {
            *counts.entry(invocation).or_default() += 1;
        }
    }

    /// The binary logarithm of a number that the orders, but for those that lead to the same, don't exceed: words are
    /// taken to be independent of each other.
    #[must_use]
    pub fn most_orders(&self) -> f64 {
        let commute = |kinds: u32| kinds.count_ones() == 1 && kinds != 1 << Touch::Changes as u32;
        let log_factorial = |n: u32| (1..=n).map(|k| f64::from(k).log2()).sum::<f64>();
        let of_word = |counts: &BTreeMap<usize, u32>| {
            let all = log_factorial(counts.values().sum());
            all - counts.values().copied().map(log_factorial).sum::<f64>()
        };
        let mut left = self.words.values().filter(|(kinds, _)| !commute(*kinds)).peekable();
        if self.count > Self::COUNTED && left.peek().is_some() {
            return f64::INFINITY;
        }
        left.map(|(_, counts)| of_word(counts)).sum()
    }
}

/// An access that an element remembers: its invocation, how many barriers of the element's address space its workgroup had
/// passed, where, and the word.
#[derive(Clone, Copy, Debug)]
struct Who {
    invocation: u32,
    epoch: u32,
    site: u32,
    word: u32,
}

const NONE_YET: Who = Who { invocation: NONE, epoch: 0, site: 0, word: 0 };

#[derive(Clone, Copy, Debug)]
struct Cell {
    write: Who,
    /// The last write by another invocation than that of `write`.
    other: Who,
    /// The last write of another word than `write` has.
    unequal: Who,
    /// The last write by a workgroup before that of `write`.
    earlier_write: Who,
    /// Two invocations that read it since the last barrier.
    reads: [Who; 2],
    /// A read by an earlier workgroup.
    earlier_read: Who,
    /// How many of `reads`, since the last write, raced with no write.
    clean: u8,
}

const EMPTY: Cell = Cell {
    write: NONE_YET,
    other: NONE_YET,
    unequal: NONE_YET,
    earlier_write: NONE_YET,
    reads: [NONE_YET; 2],
    earlier_read: NONE_YET,
    clean: 0,
};

/// A set of the bytes at which elements of a variable begin; of a texture, of the numbers of texels, row after row.
#[derive(Clone, Debug, Default)]
pub struct Touched(Vec<u64>);

impl Touched {
    /// Returns `true` if the element that begins at this byte is in the set, or the texel of this number.
    #[must_use]
    pub fn contains(&self, at: usize) -> bool {
        self.0.get(at / 64).is_some_and(|bits| bits >> (at % 64) & 1 == 1)
    }

    fn add(&mut self, at: usize) {
        if self.0.len() <= at / 64 {
            self.0.resize(at / 64 + 1, 0);
        }
        self.0[at / 64] |= 1 << (at % 64);
    }
}

/// The elements of a variable.
#[derive(Debug, Default)]
struct Shadow {
    /// `true` if some instruction writes it.
    written: bool,
    /// `true` for a variable in workgroup memory.
    own: bool,
    /// `true` for a buffer that may hold anything until it is written.
    blank: bool,
    /// Words of a variable in workgroup memory, which each workgroup begins anew.
    words: usize,
    /// Elements by the byte of a word at which they begin: 16-bit floats begin at the third one, too, and booleans at
    /// each.
    pages: [Vec<Option<Box<[Cell]>>>; 4],
    /// Elements that were written: in workgroup memory by this workgroup, in blank buffers by earlier passes, too.
    touched: Touched,
}

/// A detector's knowledge of one workgroup.
#[derive(Debug, Default)]
pub(crate) struct OfGroup {
    first: u32,
    epochs: [u32; 3],
    waiting: [bool; 3],
    /// Variables in workgroup memory.
    own: Vec<Shadow>,
}

/// A variable, whether its race is one of equal writes, both sites, and whether one workgroup has it.
type Key = (u32, bool, (u32, u32), bool);

/// Finds races while a dispatch runs.
#[derive(Debug)]
pub(crate) struct Detector {
    /// Invocations of a workgroup.
    width: u32,
    /// The first invocation of each workgroup that has run, of which not all may run.
    starts: Vec<usize>,
    /// The number of the first invocation of the workgroup that runs, among those that run.
    first: u32,
    /// Barriers that it has passed, of workgroup memory, storage and textures.
    epochs: [u32; 3],
    /// The first lane of those that run, and the address spaces that the barriers name at which the others wait.
    base: u32,
    waiting: [bool; 3],
    buffers: Vec<Shadow>,
    textures: Vec<Shadow>,
    cells: usize,
    unwatched: u64,
    races: BTreeMap<Key, (Race, HashSet<(usize, usize)>)>,
    divergences: BTreeMap<u32, Divergence>,
    outside: BTreeMap<u32, Outside>,
    unwritten: BTreeMap<u32, Unwritten>,
    /// The channels of texels, by the words that stand for them.
    texels: HashMap<u32, [u32; 4]>,
    /// How often the operations of each site that have an index ran.
    ran: Vec<u64>,
    atomics: Atomics,
}

/// An access that the machine makes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Accessed {
    pub(crate) lane: usize,
    pub(crate) site: u32,
    pub(crate) place: Place,
    /// The number of the element, of those that begin at such a place.
    pub(crate) index: usize,
    pub(crate) word: u32,
}

impl Detector {
    /// One of workgroups of so many invocations, with the elements that blank buffers have.
    pub(crate) fn new(
        code: &Code,
        invocations: usize,
        blank: &BTreeMap<(u32, u32), Touched>,
    ) -> Self {
        let shadow = |written: bool, own: bool| Shadow { written, own, ..Shadow::default() };
        let buffers = code.buffers.iter().map(|slot| {
            let own = match slot.binding {
                Binding::Resource { group, binding } => blank.get(&(group, binding)),
                Binding::Workgroup => None,
            };
            let touched = own.cloned().unwrap_or_default();
            let (blank, is_own) = (own.is_some(), slot.binding == Binding::Workgroup);
            let words = slot.workgroup_bytes().div_ceil(4) as usize;
            Shadow { blank, touched, words, ..shadow(slot.written, is_own) }
        });
        let textures = code.textures.iter().map(|slot| shadow(slot.written, false));
        Self {
            width: invocations as u32,
            starts: Vec::new(),
            first: 0,
            epochs: [0; 3],
            base: 0,
            waiting: [false; 3],
            buffers: buffers.collect(),
            textures: textures.collect(),
            cells: 0,
            unwatched: 0,
            races: BTreeMap::new(),
            divergences: BTreeMap::new(),
            outside: BTreeMap::new(),
            unwritten: BTreeMap::new(),
            texels: HashMap::new(),
            ran: vec![0; code.sites.len()],
            atomics: Atomics::default(),
        }
    }

    /// So many lanes run an operation that has an index.
    pub(crate) fn run(&mut self, site: u32, lanes: usize) {
        self.ran[site as usize] += lanes as u64;
    }

    /// A workgroup begins, whose first invocation is this one.
    pub(crate) fn begin(&mut self, first: usize) {
        self.first = self.starts.len() as u32 * self.width;
        self.starts.push(first);
        (self.epochs, self.waiting) = ([0; 3], [false; 3]);
        for shadow in self.buffers.iter_mut().filter(|shadow| shadow.own) {
            shadow.touched.0.fill(0);
            shadow.pages.iter_mut().flatten().flatten().for_each(|page| page.fill(EMPTY));
        }
    }

    /// Another workgroup goes on: its knowledge for that of the one that stops.
    pub(crate) fn exchange(&mut self, of: &mut OfGroup) {
        std::mem::swap(&mut self.first, &mut of.first);
        std::mem::swap(&mut self.epochs, &mut of.epochs);
        std::mem::swap(&mut self.waiting, &mut of.waiting);
        let own = self.buffers.iter_mut().filter(|shadow| shadow.own);
        for (number, shadow) in own.enumerate() {
            if of.own.len() == number {
                let (written, words) = (shadow.written, shadow.words);
                of.own.push(Shadow { written, own: true, words, ..Shadow::default() });
            }
            std::mem::swap(shadow, &mut of.own[number]);
        }
    }

    /// The number that an invocation has in the whole dispatch.
    fn invocation(&self, number: u32) -> usize {
        let (group, lane) = (number / self.width, number % self.width);
        self.starts[group as usize] + lane as usize
    }

    /// That of a lane of those that run.
    fn of_lane(&self, lane: usize) -> usize {
        self.invocation(self.first + self.base + lane as u32)
    }

    /// Lanes of the workgroup go on, of which this is the first.
    pub(crate) fn goes_on(&mut self, base: usize) {
        self.base = base as u32;
    }

    /// All invocations of the workgroup that haven't ended have come to a barrier: the first of each machine, with the
    /// barrier's site, and how many share one.
    pub(crate) fn release(&mut self, code: &Code, held: &[(usize, u32)], lanes: usize) {
        for (epoch, waiting) in self.epochs.iter_mut().zip(&mut self.waiting) {
            *epoch += u32::from(std::mem::take(waiting));
        }
        let Some(&(reached, site)) = held.iter().min() else { return };
        let is_here = |lane: usize| held.contains(&(lane, site));
        let missing = (0..self.width as usize).step_by(lanes).filter(|lane| !is_here(*lane));
        let missing: Vec<usize> = missing.collect();
        let Some(first) = missing.first() else { return };
        let [reached, one] =
            [reached, *first].map(|lane| self.invocation(self.first + lane as u32));
        self.divergences.entry(site).or_insert_with(|| Divergence {
            site: code.sites[site as usize].clone(),
            reached,
            missing: one,
            count: missing.len() * lanes,
            subgroup: false,
            parted: None,
        });
    }

    /// Returns `true` if accesses of a buffer can race, or reads of it come before a write.
    pub(crate) fn watches_buffer(&self, slot: u32) -> bool {
        let Shadow { written, own, blank, .. } = self.buffers[slot as usize];
        written || own || blank
    }

    /// Returns `true` if accesses of a texture can race.
    pub(crate) fn watches_texture(&self, slot: u32) -> bool {
        self.textures[slot as usize].written
    }

    /// The workgroup meets a barrier, with the invocations of `active`; the others parted from them where `parted`
    /// says.
    pub(crate) fn barrier(
        &mut self,
        code: &Code,
        site: u32,
        barrier: Barrier,
        (parted, active): (&[Option<u32>], impl Iterator<Item = bool> + Clone),
    ) {
        let spaces = [Barrier::WORK_GROUP, Barrier::STORAGE, Barrier::TEXTURE];
        for (waiting, space) in self.waiting.iter_mut().zip(spaces) {
            *waiting |= barrier.contains(space);
        }
        self.meet(code, site, (0, false), (parted, active));
    }

    /// Invocations that should all meet an operation: the first of these lanes, whether they are a subgroup, where the
    /// lanes of the workgroup parted, and which of these do.
    pub(crate) fn meet(
        &mut self,
        code: &Code,
        site: u32,
        (first, subgroup): (usize, bool),
        (parted, active): (&[Option<u32>], impl Iterator<Item = bool> + Clone),
    ) {
        let missing = || active.clone().enumerate().filter(|(_, active)| !active);
        if let (Some((lane, _)), Some(here)) = (missing().next(), active.clone().position(|a| a)) {
            let parted = parted[first + lane];
            let [reached, missing_one] = [here, lane].map(|lane| self.of_lane(first + lane));
            self.divergences.entry(site).or_insert_with(|| Divergence {
                site: code.sites[site as usize].clone(),
                reached,
                missing: missing_one,
                count: missing().count(),
                subgroup,
                parted: parted.map(|site| code.sites[site as usize].clone()),
            });
        }
    }

    /// An element of a buffer is read, written or both, by an atomic or not.
    #[inline]
    pub(crate) fn touch(
        &mut self,
        code: &Code,
        slot: u32,
        accessed: Accessed,
        (reads, writes): (bool, bool),
    ) {
        let Accessed { lane, site, place: Place::Byte(byte), word, .. } = accessed else { return };
        let is_blank = |shadow: &Shadow| {
            (shadow.own || shadow.blank) && !shadow.touched.contains(byte as usize)
        };
        if reads && is_blank(&self.buffers[slot as usize]) {
            let invocation = self.of_lane(lane);
            let shadow = &self.buffers[slot as usize];
            let site_of = || code.sites[site as usize].clone();
            let new = || Unwritten {
                access: Access { site: site_of(), invocation, writes: false, word, texel: None },
                variable: code.buffers[slot as usize].name.clone(),
                own: shadow.own,
                byte,
                count: 0,
            };
            self.unwritten.entry(site).or_insert_with(new).count += 1;
        }
        if writes {
            self.buffers[slot as usize].touched.add(byte as usize);
        }
    }

    /// A lane has an atomic at a byte of a buffer.
    pub(crate) fn atomic(&mut self, lane: usize, (slot, at): (u32, usize), kind: Touch) {
        let group = if self.buffers[slot as usize].own { self.first + 1 } else { 0 };
        self.atomics.add(self.of_lane(lane), (slot, group, at as u32), kind);
    }

    /// The index of a lane leaves its array.
    pub(crate) fn leaves(&mut self, code: &Code, site: u32, lane: usize, beyond: Beyond<'_>) {
        let Beyond { writes, bounds, variable, nested, index } = beyond;
        let invocation = self.of_lane(lane);
        let new = || Outside {
            site: code.sites[site as usize].clone(),
            invocation,
            count: 0,
            writes,
            bounds,
            variable: variable.map(str::to_owned),
            nested,
            index,
            of: 0,
            number: site,
        };
        self.outside.entry(site).or_insert_with(new).count += 1;
    }

    /// An element of a buffer is read or written. True if its workgroup has written it.
    #[inline]
    pub(crate) fn buffer(
        &mut self,
        code: &Code,
        slot: u32,
        accessed: Accessed,
        writes: bool,
    ) -> bool {
        let space = usize::from(!self.buffers[slot as usize].own);
        self.access(code, (slot, space), accessed, writes)
    }

    /// A texel with these channels is read or written.
    pub(crate) fn texture(
        &mut self,
        code: &Code,
        slot: u32,
        accessed: Accessed,
        (texel, writes): ([u32; 4], bool),
    ) {
        /// Texels that are kept for a message: a megabyte of them.
        const MOST: usize = 1 << 16;
        if self.texels.len() < MOST {
            self.texels.insert(accessed.word, texel);
        }
        if writes {
            self.textures[slot as usize].touched.add(accessed.index);
        }
        self.access(code, (slot, 2), accessed, writes);
    }

    #[inline]
    fn access(
        &mut self,
        code: &Code,
        (slot, space): (u32, usize),
        accessed: Accessed,
        writes: bool,
    ) -> bool {
        let Accessed { lane, site, place, index, word } = accessed;
        let plane = match place {
            Place::Byte(at) => (at & 3) as usize,
            Place::Texel(_) => 0,
        };
        let who = Who {
            invocation: self.first + self.base + lane as u32,
            epoch: self.epochs[space],
            site,
            word,
        };
        let (first, width) = (self.first, self.width);
        let shadows = if space == 2 { &mut self.textures } else { &mut self.buffers };
        let Some(cell) = shadows[slot as usize].cell(plane, index, &mut self.cells) else {
            self.unwatched += 1;
            return false;
        };
        let here = |other: Who| other.invocation >= first && other.invocation - first < width;
        let races = |other: &Who| {
            other.invocation != NONE
                && other.invocation != who.invocation
                && (!here(*other) || other.epoch == who.epoch)
        };
        let is_read_now = here(cell.reads[0]) && cell.reads[0].epoch == who.epoch;
        // A write in this epoch would race with one of two readers, so a third one races with none.
        if !writes && is_read_now && cell.clean == 2 {
            return here(cell.write);
        }
        let known = [&cell.write, &cell.other, &cell.unequal, &cell.earlier_write];
        let is_raced = known.into_iter().any(races);
        let before = if is_raced { known.map(|who| *who) } else { [NONE_YET; 4] };
        let mut read = None;
        if writes {
            read = [cell.reads[0], cell.reads[1], cell.earlier_read].into_iter().find(races);
            if cell.write.invocation != who.invocation {
                cell.other = cell.write;
            }
            if cell.write.word != word {
                cell.unequal = cell.write;
            }
            if !here(cell.write) {
                cell.earlier_write = cell.write;
            }
            cell.write = who;
            cell.clean = 0;
        } else if is_read_now {
            if cell.reads[0].invocation != who.invocation {
                cell.reads[1] = who;
                cell.clean = if is_raced { 0 } else { 2 * cell.clean };
            }
        } else {
            cell.clean = u8::from(!is_raced);
            if !here(cell.reads[0]) {
                cell.earlier_read = cell.reads[0];
            }
            cell.reads = [who, NONE_YET];
        }
        let is_written = here(cell.write);
        if is_raced || read.is_some() {
            self.raced(code, (slot, space), (who, writes), (before, read), (place, plane, index));
        }
        is_written
    }

    /// An access races with one of those before it.
    #[cold]
    fn raced(
        &mut self,
        code: &Code,
        (slot, space): (u32, usize),
        (who, writes): (Who, bool),
        (before, read): ([Who; 4], Option<Who>),
        (place, plane, index): (Place, usize, usize),
    ) {
        let Who { site, word, .. } = who;
        let (first, width) = (self.first, self.width);
        let here = |other: Who| other.invocation >= first && other.invocation - first < width;
        let races = |other: &&Who| {
            other.invocation != NONE
                && other.invocation != who.invocation
                && (!here(**other) || other.epoch == who.epoch)
        };
        // Two writes of one word show less than a read beside one of them, or a write of another word.
        let differs = |other: &&Who| !writes || other.word != word;
        let racing = || before.iter().filter(races);
        let found = racing().find(differs).map(|other| (*other, true));
        let found = found.or(read.map(|other| (other, false)));
        let found = found.or_else(|| racing().next().map(|other| (*other, true)));
        let Some((other, other_writes)) = found else { return };
        let one_workgroup = here(other);
        let equal = writes && other_writes && other.word == word;
        let sites = (other.site.min(site), other.site.max(site));
        let variable = slot | u32::from(space == 2) << 31;
        let key = (variable, equal, sites, one_workgroup);
        if let Some((race, elements)) = self.races.get_mut(&key) {
            if elements.insert((plane, index)) {
                race.elements += 1;
            }
            return;
        }
        let least = (variable, equal, (0, 0), false);
        let most = (variable, equal, (u32::MAX, u32::MAX), true);
        if self.races.range(least..=most).count() >= MOST_RACES {
            return;
        }
        let (variable, binding) = match space {
            2 => {
                let slot = &code.textures[slot as usize];
                (slot.name.clone(), Some((slot.group, slot.binding)))
            }
            _ => {
                let slot = &code.buffers[slot as usize];
                let binding = match slot.binding {
                    Binding::Resource { group, binding } => Some((group, binding)),
                    Binding::Workgroup => None,
                };
                (slot.name.clone(), binding)
            }
        };
        let access = |who: Who, writes: bool| Access {
            site: code.sites[who.site as usize].clone(),
            invocation: self.invocation(who.invocation),
            writes,
            word: who.word,
            texel: self.texels.get(&who.word).filter(|_| space == 2).copied(),
        };
        let (first, second) = (access(other, other_writes), access(who, writes));
        let race = Race { variable, binding, place, first, second, one_workgroup, elements: 1 };
        self.races.insert(key, (race, HashSet::from([(plane, index)])));
    }

    /// Ends the run and returns the findings.
    pub(crate) fn end(self, code: &Code) -> Observed {
        let slots = code.buffers.iter().zip(self.buffers);
        let written = slots.filter_map(|(slot, shadow)| match slot.binding {
            Binding::Resource { group, binding } if slot.written => {
                Some(((group, binding), shadow.touched))
            }
            _ => None,
        });
        let textures = code.textures.iter().zip(self.textures).filter(|(slot, _)| slot.written);
        let textures = textures.map(|(slot, shadow)| ((slot.group, slot.binding), shadow.touched));
        let written = written.chain(textures).collect();
        let outside = self.outside.into_values();
        let outside = outside.map(|one| Outside { of: self.ran[one.number as usize], ..one });
        let outside = outside.collect();
        let mut races: Vec<Race> = self.races.into_values().map(|(race, _)| race).collect();
        races.sort_by_key(|race| {
            let place = race.second.site.span.to_range().map(|range| range.start);
            (race.writes_equally(), place, !race.one_workgroup)
        });
        Observed {
            races,
            divergences: self.divergences.into_values().collect(),
            outside,
            unwritten: self.unwritten.into_values().collect(),
            written,
            stopped: None,
            rounds: 0,
            turns: 0,
            atomics: self.atomics,
            order: Vec::new(),
            invocations: self.starts.len() * self.width as usize,
            unwatched: self.unwatched,
        }
    }
}

impl Shadow {
    /// An element; `None`: there are too many.
    fn cell(&mut self, plane: usize, index: usize, cells: &mut usize) -> Option<&mut Cell> {
        let pages = &mut self.pages[plane];
        let page = index / PAGE;
        if page >= pages.len() {
            pages.resize_with(page + 1, || None);
        }
        let page = &mut pages[page];
        if page.is_none() {
            if *cells + PAGE > MOST_CELLS {
                return None;
            }
            *cells += PAGE;
        }
        let count = if self.own { PAGE.min(self.words - index / PAGE * PAGE) } else { PAGE };
        let page = page.get_or_insert_with(|| vec![EMPTY; count].into_boxed_slice());
        Some(&mut page[index % PAGE])
    }
}
