// A hash table of positions: where a state, or a key, is among those known.
//
// The table has a power of two of slots, at least half of them empty (-1). Search goes on from slot
// to slot (linear probing: Knuth, "The Art of Computer Programming" 3, section 6.4).
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace serp {

using Digest = std::uint64_t;

/// The digest of nothing.
inline constexpr Digest START = 0xCBF29CE484222325;

/// Returns a digest with 64 further bits mixed in.
inline Digest mixed(Digest digest, std::uint64_t bits) {
    digest = (digest ^ bits) * 0x9E3779B97F4A7C15;
    return digest ^ (digest >> 29);
}

/// Returns the bits of a number; -0.0 equals 0.0.
inline std::uint64_t bits_of(double number) { return std::bit_cast<std::uint64_t>(number + 0.0); }
inline std::uint64_t bits_of(std::uint64_t bits) { return bits; }

/// Returns a digest all of whose bits depend on all that was mixed in.
inline Digest finished(Digest digest) { return mixed(digest ^ (digest >> 32), 0); }

/// Returns the digest of a row of numbers, or of words of bits.
template <class Number>
Digest digest_of_row(const Number* row, std::size_t width) {
    Digest digest = START;
    for (std::size_t i = 0; i < width; ++i) digest = mixed(digest, bits_of(row[i]));
    return finished(digest);
}

/// Positions by their digests. Equality is decided by the caller, who knows the entries.
class HashTable {
public:
    /// Forgets all entries and makes room for so many.
    void clear(std::size_t entries = 0) {
        std::size_t size = 2;
        while (size < 2 * entries) size *= 2;
        slots_.assign(size, -1);
        used_ = 0;
    }

    /// Returns the position of the entry with this digest for which `equal(position)` holds;
    /// -1 where there is none.
    template <class Equal>
    std::int32_t find(Digest digest, Equal equal) const {
        if (slots_.empty()) return -1;
        return slots_[slot_of(digest, equal)];
    }

    /// Returns the position of an entry, or adds it as `position`. `digest_at(position)` returns the
    /// digests of former entries, where the table has to grow.
    template <class Equal, class DigestAt>
    std::int32_t find_or_add(Digest digest, std::int32_t position, Equal equal, DigestAt digest_at) {
        if (2 * (used_ + 1) > slots_.size()) grow(digest_at);
        const std::size_t slot = slot_of(digest, equal);
        if (slots_[slot] < 0) {
            slots_[slot] = position;
            ++used_;
        }
        return slots_[slot];
    }

private:
    template <class Equal>
    std::size_t slot_of(Digest digest, Equal equal) const {
        const std::size_t mask = slots_.size() - 1;
        std::size_t slot = digest & mask;
        while (slots_[slot] >= 0 && !equal(slots_[slot])) slot = (slot + 1) & mask;
        return slot;
    }

    template <class DigestAt>
    void grow(DigestAt digest_at) {
        std::vector<std::int32_t> former(slots_.empty() ? 2 : 2 * slots_.size(), -1);
        former.swap(slots_);
        const std::size_t mask = slots_.size() - 1;
        for (const std::int32_t position : former) {
            if (position < 0) continue;
            std::size_t slot = digest_at(position) & mask;
            while (slots_[slot] >= 0) slot = (slot + 1) & mask;
            slots_[slot] = position;
        }
    }

    std::vector<std::int32_t> slots_;
    std::size_t used_ = 0;
};

}  // namespace serp
