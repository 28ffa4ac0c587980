/* As refine_rows.cl, by work-groups: a group takes 2 width rows of one plane as `width` complex transforms. For lengths
 * without a stage of radix 43 whose other stages have butterflies. The inverse transform takes the stages backwards,
 * from natural to digit-reversed order, which is the order of the forward transform's input: what is done to pixels
 * needs no order.
 *
 * Where a sensor crops (REFINE_CROPPED, a program of its own), the groups from job.data.first_group on take rows of the
 * frame instead, as in refine_frame_rows.cl, with the same steps but for HADA_REFINE_TO_SPECTRA, and no clipping.
 *
 * spectra: half spectra of the planes' rows, complex [plane][block of eight columns][row of the window][8], and from
 *     job.data.at on of the frame's rows, complex [set * channel][block][row of the frame][8]
 * planes: pixels [plane][row of the window][column of the window]
 * duals: e' as [set * channel][row][column of the frame]; frame: [channel][row][column]; weights: the same from the
 * beginning on, NULL where job.data.has_weights is 0
 * partial: [group of the frame], sums of e'^2
 * The buffers of the frame are NULL where no sensor crops.
 * table: the transform along rows; scratch: float2 [n][width]
 * Dimension: groups of rows of all planes, then of all frames. */
#include "shared_refine.h"
#define REFINE_GROUP HADA_REFINE_FUSED_GROUP
#include "inc_refine_groups.h"

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_group_rows(__global float *spectra, __global float *planes, __global float *duals, __global const float *frame,
                  __global const float *weights, __global float *partial, hada_refine_rows_pair job,
                  __global const int *table, __local float2 *scratch)
{
#if REFINE_CROPPED
    REFINE_LOCAL
    const int on_frame = get_group_id(0) >= job.data.first_group;
#else
    const int on_frame = 0;
#endif
    const int group = get_group_id(0) - (on_frame ? job.data.first_group : 0);
    const int height = on_frame ? job.frame.rows : job.planes.rows, cols = on_frame ? job.frame.cols : job.planes.cols;
    const int col0 = on_frame ? job.frame.col0 : job.planes.col0, pass = job.planes.pass;
    const int clip = !on_frame && pass & HADA_REFINE_CLIP, inverse = pass & HADA_REFINE_TO_PIXELS;
    const int forward = (on_frame ? job.frame.pass : pass) & HADA_REFINE_TO_SPECTRA;
    const int n = table[FFT_LENGTH], stages = table[FFT_STAGES], width = job.planes.width;
    const int blocks = n / 2 / HADA_FFT_BLOCK + 1, groups = (height + 2 * width - 1) / (2 * width);
    const int plane = group / groups, first = group % groups * 2 * width;
    const int count = min(2 * width, height - first);
    const fft_side side = fft_side_of(width);
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    __global float2 *values = (__global float2 *)spectra + (on_frame ? job.data.at : 0) +
                              (size_t)(plane * blocks * height + first) * HADA_FFT_BLOCK; /* an int has room */

    for (int w = 0; w < (inverse ? width : 0); ++w)
        refine_rows_together(scratch, values, height, w, count, n, width, 0);
    refine_stages_back(scratch, n, side, table, floats, 0, inverse ? stages : 0);
    FFT_WAIT();
    /* made here, not above: registers are scarce in the stages */
    __global float *pixels = (on_frame ? duals : planes) + ((size_t)plane * height + first) * cols;
#if REFINE_CROPPED
    const size_t seen = ((size_t)(plane % (int)job.data.channels) * height + first) * cols;
    float sum = 0.0f;
#endif
    for (int w = 0; w < width; ++w)
        FFT_SHARE (x, n) {
            const int c = x - col0, is_pixel = (uint)c < (uint)cols;
            __local float2 *at = scratch + place[x] * width + w;
            __global float *u = pixels + (size_t)w * cols + c, *v = u + (size_t)width * cols;
            const int u_there = is_pixel && w < count, v_there = is_pixel && width + w < count;
            float2 value = (float2)0.0f;
            if (inverse) {
                value = job.planes.scale * *at;
            } else {
                value.x = u_there ? *u : 0.0f;
                value.y = v_there ? *v : 0.0f;
            }
#if REFINE_CROPPED
            if (on_frame && inverse) {
                const size_t at_u = seen + (size_t)w * cols + c, at_v = at_u + (size_t)width * cols;
                __global const float *b = frame + job.data.frame_offset;
                value.x = (value.x - (u_there ? b[at_u] : 0.0f)) * job.data.scale;
                value.y = (value.y - (v_there ? b[at_v] : 0.0f)) * job.data.scale;
                if (job.data.has_weights) {
                    value.x = REFINE_WEIGHED(value.x, u_there ? weights[at_u] : 0.0f, job.data.mu);
                    value.y = REFINE_WEIGHED(value.y, v_there ? weights[at_v] : 0.0f, job.data.mu);
                }
                sum = fma(u_there ? value.x : 0.0f, value.x, sum);
                sum = fma(v_there ? value.y : 0.0f, value.y, sum);
            }
#endif
            if (clip)
                value = max(value, 0.0f);
            /* zero beyond the window and in rows that do not exist */
            if (!u_there)
                value.x = 0.0f;
            if (!v_there)
                value.y = 0.0f;
            if (inverse && u_there)
                *u = value.x;
            if (inverse && v_there)
                *v = value.y;
            *at = value;
        }
#if REFINE_CROPPED
    REFINE_TREE(sum)
    if (on_frame && inverse && get_local_id(0) == 0)
        partial[job.data.sums + get_group_id(0) - job.data.first_group] = refine_tree[0];
#endif
    refine_stages(scratch, n, side, table, floats, 0, 0, forward ? stages : 0);
    FFT_WAIT();
    for (int w = 0; w < (forward ? min(width, count) : 0); ++w)
        refine_rows_apart(scratch, values, height, w, count, n, width, 0);
}
