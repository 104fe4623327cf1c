// The audit trail of the clear reference: what storage keeps of it, and the way back.
#pragma once

#include <optional>
#include <string>

#include "estimator/inference/relearner.h"
#include "storage/references.h"

namespace lampglow::daemon {

// The record of a reference as its clear brackets gave it, or as a night changed it.
storage::ReferenceRecord reference_record(const ClearReference& reference, TimePoint valid_from);
storage::ReferenceRecord reference_record(const ClearReference& reference,
                                          const inference::Relearner::Settled& settled);

// One line for people: what a night taught, and by what evidence.
std::string lesson_text(const ClearReference& changed, const inference::Relearner::Settled& settled);

// `base`, as the clear brackets give it, with what service taught since, as it is stored. Empty if the record
// rests on other brackets. Lamps that the record does not know stay as they are.
std::optional<ClearReference> with_record(const ClearReference& base, const storage::ReferenceRecord& record);

}  // namespace lampglow::daemon
