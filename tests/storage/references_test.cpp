#include "storage/references.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "storage/reader.h"
#include "storage/store.h"
#include "tests/storage/sample.h"
#include "tests/storage/temporary_directory.h"

namespace lampglow::storage {
namespace {

using testing_support::at;
using testing_support::harbour;
using testing_support::TemporaryDirectory;

ReferenceRecord relearned() {
  ReferenceRecord record;
  record.valid_from_utc = at("2026-01-16T11:39:16.8Z");
  record.origin = ReferenceOrigin::relearned;
  record.base_utc = at("2026-01-15T17:40:00Z");
  record.frames = 37;
  record.hours = 6.25;
  record.mor_low_m = 9100.5;
  record.ln_common = -0.031;
  record.halo_frames = 23;
  record.lamps = {{"L1", 81234.5, -0.04, at("2026-01-16T11:39:16.8Z"), 0.175, at("2026-01-15T11:39:16.8Z")},
                  {"stray-1", 5.25, 0, {}, 0, {}}};
  return record;
}

TEST(References, GivesBackEveryFieldAndKeepsEarlierOnes) {
  TemporaryDirectory directory;
  const auto file = directory / "lampglow.db";
  Store store(file);
  const CameraNumber quay = store.upsert_camera("quay", harbour());
  const CameraNumber other = store.upsert_camera("other", harbour());
  ReferenceRecord first = relearned();
  first.origin = ReferenceOrigin::clear_brackets;
  first.mor_low_m.reset();
  first.ln_common.reset();
  const auto one = store.put_reference(quay, first);
  const auto two = store.put_reference(quay, relearned());
  ReferenceRecord back = first;
  back.origin = ReferenceOrigin::restored;
  back.restored_number = one;
  const auto three = store.put_reference(quay, back);
  EXPECT_LT(one, two);
  EXPECT_LT(two, three);

  ReferenceReader reader(file);
  EXPECT_FALSE(reader.reference(other));
  ASSERT_EQ(reader.references(quay).size(), 3U);
  EXPECT_EQ(reader.reference(quay)->number, three);
  EXPECT_EQ(reader.reference(quay)->restored_number, one);
  EXPECT_FALSE(reader.reference(other, two)) << "another camera's";
  const auto read = reader.reference(quay, two);
  ASSERT_TRUE(read);
  const ReferenceRecord wanted = relearned();
  EXPECT_EQ(read->valid_from_utc, wanted.valid_from_utc);
  EXPECT_EQ(read->origin, wanted.origin);
  EXPECT_EQ(read->base_utc, wanted.base_utc);
  EXPECT_EQ(read->frames, wanted.frames);
  EXPECT_EQ(read->hours, wanted.hours);
  EXPECT_EQ(read->mor_low_m, wanted.mor_low_m);
  EXPECT_EQ(read->ln_common, wanted.ln_common);
  EXPECT_EQ(read->halo_frames, wanted.halo_frames);
  EXPECT_FALSE(read->restored_number);
  ASSERT_EQ(read->lamps.size(), 2U);
  EXPECT_EQ(read->lamps[0].id, "L1");
  EXPECT_EQ(read->lamps[0].strength, 81234.5);
  EXPECT_EQ(read->lamps[0].ln_relearned, -0.04);
  EXPECT_EQ(read->lamps[0].relearned_utc, wanted.lamps[0].relearned_utc);
  EXPECT_FALSE(read->lamps[1].relearned_utc);
  EXPECT_EQ(read->lamps[0].ln_halo, 0.175);
  EXPECT_EQ(read->lamps[0].halo_utc, wanted.lamps[0].halo_utc);
  EXPECT_EQ(read->lamps[1].ln_halo, 0);
  EXPECT_FALSE(read->lamps[1].halo_utc);
  EXPECT_FALSE(reader.reference(quay, one)->mor_low_m);
}

}  // namespace
}  // namespace lampglow::storage
