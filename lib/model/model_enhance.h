/* The net of a model in model files. Internal. */
#ifndef HADA_MODEL_MODEL_ENHANCE_H
#define HADA_MODEL_MODEL_ENHANCE_H

#include "model/model.h"
#include "netlist/weights_file.h"

/* Metadata and tensors, declared after the model's own; then their data. Nothing where there is no net. */
hada_status hada_model_declare_enhance(const hada_model *model, hada_tensors_writer *writer, hada_error *err);
hada_status hada_model_write_enhance(const hada_model *model, hada_tensors_writer *writer, hada_error *err);

/* Takes the net of a file, where it holds one. */
hada_status hada_model_read_enhance(hada_model *model, const hada_tensors *file, hada_error *err);

#endif
