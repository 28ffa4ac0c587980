/* Files of models that somebody has changed. */
#ifndef HADA_TESTS_MODEL_REWRITE_H
#define HADA_TESTS_MODEL_REWRITE_H

#include "io/safetensors.h"
#include "testing.h"

/* A copy of a model's file with another text under a key of its metadata, and without the tensor `drop` or (cut) with
 * one row less of it. */
static inline void rewrite_model(const char *from, const char *to, const char *key, const char *value, const char *drop,
                                 int cut)
{
    hada_tensors *file;
    hada_tensors_writer *writer;
    static const char *const keys[] = {"format",
                                       "version",
                                       "library",
                                       "form",
                                       "boundary",
                                       "raw",
                                       "grid",
                                       "window",
                                       "alpha",
                                       "lambda",
                                       "dark",
                                       "refine_steps",
                                       "refine_rho",
                                       "refine_tv",
                                       "noise",
                                       "scene_response",
                                       "refine_share",
                                       "refine_ridge",
                                       "refine_colour",
                                       "refine_noise",
                                       "enhance",
                                       "enhance_size",
                                       "refine_noise_largest"};
    ASSERT_OK(hada_tensors_open(&file, from, err));
    ASSERT_OK(hada_tensors_create(&writer, to, err));
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++) {
        const char *text = strcmp(keys[i], key) ? hada_tensors_meta(file, keys[i]) : value;
        if (text)
            ASSERT_OK(hada_tensors_put_meta(writer, keys[i], text, err));
    }
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < hada_tensors_count(file); i++) {
            const hada_stored_tensor *tensor = hada_tensors_at(file, i);
            int64_t shape[HADA_TENSOR_DIMS];
            size_t bytes = tensor->bytes;
            memcpy(shape, tensor->shape, sizeof shape);
            if (!strcmp(tensor->name, drop)) {
                if (!cut)
                    continue;
                shape[tensor->dims - 2]--;
                bytes = bytes / (size_t)tensor->shape[tensor->dims - 2] * (size_t)shape[tensor->dims - 2];
            }
            if (pass)
                ASSERT_OK(hada_tensors_write(writer, tensor->data, bytes, err));
            else
                ASSERT_OK(hada_tensors_declare(writer, tensor->name, tensor->type, tensor->dims, shape, err));
        }
    hada_tensors_close(&file);
    ASSERT_OK(hada_tensors_finish(&writer, err));
}

#endif
