/* The proximal step of the refinement, over an array of vectors: the planes, one after the other, padded at the end. */

/* u = max(0, w) in place: w = x + d in the window. Outside it u is 0 and nothing is stored. */
__kernel void refine_prox(__global float *w)
{
    const size_t i = get_global_id(0);
    vstore8(max(vload8(i, w), 0.0f), i, w);
}
