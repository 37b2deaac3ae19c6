//! The columns that store registers: each register has one value for each lane.

/// All registers of one register file. The values of a register in all lanes are a column.
#[derive(Debug)]
pub(crate) struct Columns<T> {
    columns: Vec<Box<[T]>>,
    /// Spare columns for results. An operation writes its results into spare columns while it reads the columns of its
    /// arguments. Then the spare columns replace the old columns of the result registers.
    spares: [Box<[T]>; 4],
    width: usize,
}

impl<T: Copy + Default> Columns<T> {
    pub(crate) fn new(count: usize, width: usize) -> Self {
        let column = || vec![T::default(); width].into_boxed_slice();
        Self {
            columns: (0..count).map(|_| column()).collect(),
            spares: std::array::from_fn(|_| column()),
            width,
        }
    }

    #[inline]
    pub(crate) fn get(&self, register: u32) -> &[T] {
        &self.columns[register as usize]
    }

    #[inline]
    pub(crate) fn get_mut(&mut self, register: u32) -> &mut [T] {
        &mut self.columns[register as usize]
    }

    /// Applies `f` to each lane. `registers` lists the registers of the results, then those of the arguments.
    #[inline(always)]
    pub(crate) fn map<const I: usize, const O: usize>(
        &mut self,
        registers: &[u32],
        f: impl Fn([T; I]) -> [T; O],
    ) {
        let (outs, ins) = registers.split_at(O);
        let width = self.width;
        let columns = &self.columns;
        let ins: [&[T]; I] = std::array::from_fn(|k| &columns[ins[k] as usize][..width]);
        let mut spares = self.spares.iter_mut();
        let results: [&mut [T]; O] = std::array::from_fn(|_| {
            &mut spares.next().expect("no rule has more than four results")[..width]
        });
        for lane in 0..width {
            let y = f(std::array::from_fn(|k| ins[k][lane]));
            for k in 0..O {
                results[k][lane] = y[k];
            }
        }
        for (k, &out) in outs.iter().enumerate() {
            std::mem::swap(&mut self.columns[out as usize], &mut self.spares[k]);
        }
    }

    /// Computes the new values of a register in a spare column, which then replaces the register's old column.
    #[inline(always)]
    pub(crate) fn write(&mut self, register: u32, f: impl Fn(&Self, &mut [T])) {
        let mut spare = std::mem::take(&mut self.spares[0]);
        f(self, &mut spare);
        std::mem::swap(&mut self.columns[register as usize], &mut spare);
        self.spares[0] = spare;
    }

    #[inline]
    pub(crate) fn copy(&mut self, to: u32, from: u32) {
        let (to, from) = (to as usize, from as usize);
        if let Ok([to, from]) = self.columns.get_disjoint_mut([to, from]) {
            to.copy_from_slice(from);
        }
    }
}
