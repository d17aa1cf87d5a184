// snippet print
// Pixels of a cell whose corners' gel came from places that are `moved` away
const int rows = image.shape[1], columns = image.shape[2];
const int width = ink.shape[1], height = ink.shape[0];
const float step = 1.0f / spacing;
for (int a = 0; a < spacing && i * spacing + a < rows; ++a) {
    const int row = i * spacing + a;
    const float v = a * step;
    const wp::vec2f left_by = corner * (1.0f - v) + below * v;
    const wp::vec2f along = (right * (1.0f - v) + opposite * v - left_by) * step;
    for (int c = 0; c < spacing && j * spacing + c < columns; ++c) {
        const int column = j * spacing + c;
        const float x = column - (left_by[0] + along[0] * c), y = row - (left_by[1] + along[1] * c);
        const int near_x = wp::clamp((int)(x + 0.5f), 0, columns - 1);
        const int near_y = wp::clamp((int)(y + 0.5f), 0, rows - 1);
        if (!touched.data[near_y * columns + near_x]) continue;
        const float at_x = wp::clamp(fine * x, 0.0f, width - 1.0f);
        const float at_y = wp::clamp(fine * y, 0.0f, height - 1.0f);
        const int left = wp::min((int)at_x, width - 2), top = wp::min((int)at_y, height - 2);
        const float s = at_x - left, t = at_y - top;
        const float* upper = (const float*)(ink.data + top * width + left);
        const float* lower = upper + 4 * width;
        float share[4];
        for (int n = 0; n < 4; ++n) {
            const float over = upper[n] * (1.0f - s) + upper[n + 4] * s;
            share[n] = over * (1.0f - t) + (lower[n] * (1.0f - s) + lower[n + 4] * s) * t;
        }
        wp::uint8* to = image.data + 3 * ((env * rows + row) * columns + column);
        for (int n = 0; n < 3; ++n) {
            const float level = dark[n] + share[0] * (to[n] - dark[n]) + share[1 + n];
            to[n] = (wp::uint8)wp::clamp(level + 0.5f, 0.0f, 255.0f);
        }
    }
}
