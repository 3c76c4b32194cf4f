#include "core.h"
using std::map;
int main(int c,char**v){map<int,vector<double>> h;for(int k=1;k+1<c;k+=2){auto runs=load(v[k]);auto geo=loadgeo(v[k+1]);for(auto&r:runs){auto&s=geo[r.key];for(auto&sg:r.segs)for(auto&q:sg)if(q.tag=='S')for(auto&y:q.rays){double t=castray(s,q.T.x,q.T.y,q.T.h+y.a);double rel=(y.d-y.near_);int b=!y.k?-99:(int)floor(min(rel,1.)/.05);h[b].push_back(t-y.near_);}}}
 for(auto&[k,a]:h){sort(a.begin(),a.end());printf("d-near %.2f n %6zu  true-near: p5 %.2f p10 %.2f p25 %.2f p50 %.2f p75 %.2f p90 %.2f\n",k*.05,a.size(),a[a.size()/20],a[a.size()/10],a[a.size()/4],a[a.size()/2],a[a.size()*3/4],a[a.size()*9/10]);}}
