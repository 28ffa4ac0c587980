/* The planes of a result: the window of x, which stands with a pitch, with nothing negative; x itself, in place, keeps
 * no more than that. window: rows x cols from (row0, col0) of x, outside it x becomes 0. Dimensions: columns of x and
 * rows of x, planes; the padding of x is left alone. */
__kernel void classic_crop(__global float *planes, __global float *window, int pitch, int row0, int col0, int rows,
                           int cols)
{
    const int j = get_global_id(0), i = get_global_id(1), plane = get_global_id(2);
    const size_t at = ((size_t)plane * get_global_size(1) + i) * pitch + j;
    const int row = i - row0, col = j - col0, inside = row >= 0 && row < rows && col >= 0 && col < cols;
    const float value = inside ? max(planes[at], 0.0f) : 0.0f;
    planes[at] = value;
    if (inside)
        window[((size_t)plane * rows + row) * cols + col] = value;
}
