@group(0) @binding(0) var<storage, read_write> keys: array<u32>;
var<workgroup> all: array<u32, 64>;

@compute @workgroup_size(64)
fn sort(@builtin(local_invocation_index) i: u32) {
    let key = keys[i];
    all[i] = key;
    workgroupBarrier();
    storageBarrier(); // each has read its key before another one writes there
    var rank = 0u;
    for (var j = 0u; j < 64u; j++) {
        rank += u32(all[j] < key || (all[j] == key && j < i));
    }
    keys[rank] = key;
}
