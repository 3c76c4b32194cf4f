#include "core.h"
// parameters
static map<string,double> P={{"reach",1.0},{"step",.075},{"beside",.5},{"not",-.5},{"cross",0},{"hid",0},{"away",6},{"quad",0},{"better",2},{"max",3},{"wd",0},{"free",0},{"sq",0},{"head",0},{"hstep",2},{"hcost",0},{"far",0},{"relw",0},{"minfit",0},{"usew",1}};
double score(Map&m,Pose p,const Rays&rays){double s=0;const int B[4]={N,-N,1,-1};
 static const double c_cross=P["cross"],c_hid=P["hid"],b=P["beside"],nt=P["not"],mx=P["max"],wd=P["wd"];
 for(auto&r:rays){double t=p.h+r.a,dx=cos(t),dy=sin(t);
  if(r.k&&r.d<mx){double w=1/(1+wd*r.d*r.d);int c=m.cell(p.x+r.d*dx,p.y+r.d*dy);
   if(m.occ(c))s+=w;else{bool bs=false;for(int o:B)bs|=m.occ(c+o);if(bs)s+=b*w;else if(m.fre(c))s+=nt*w;}
  }
  if(c_cross){double end=min(r.k?r.low:0,min(r.d,mx))-.35;for(double a=.3;a<end;a+=CELL){int c=m.cell(p.x+a*dx,p.y+a*dy);if(m.e[c]>1){s-=c_cross;break;}}}
  if(c_hid&&!r.k){bool all=true;for(double a=.2;a<r.near_&&all;a+=CELL*.8)all=m.fre(m.cell(p.x+a*dx,p.y+a*dy));if(all)s-=c_hid;}
 }return s;}
Pose match(Map&m,Pose p,const Rays&rays,double dist){
 double reach=P["reach"],step=P["step"],away=P["away"],sq=P["sq"];Pose best=p;double most=score(m,p,rays)+P["better"];
 if(P["relw"])reach=min(reach,.15+P["relw"]*dist);
 double hr=P["head"]*M_PI/180,hs=P["hstep"]*M_PI/180;
 const double qd=P["quad"],hc=P["hcost"];for(int q=0;q<(qd?4:1);q++)for(double dh=-hr;dh<=hr+1e-9;dh+=hs)for(double dx=-reach;dx<=reach+1e-9;dx+=step)for(double dy=-reach;dy<=reach+1e-9;dy+=step){
  double d=sqrt(dx*dx+dy*dy);if(d>reach)continue;
  Pose c={p.x+dx,p.y+dy,p.h+q*M_PI/2+dh};double s=score(m,c,rays)-away*d-sq*d*d-(q?qd*(q==2?2:1):0)-hc*fabs(dh);
  if(s>most)most=s,best=c;}
 return best;}
int main(int c,char**v){vector<const char*> files;string name;for(int i=1;i<c;i++){string a=v[i];auto e=a.find('=');if(e!=string::npos){P[a.substr(0,e)]=stod(a.substr(e+1));name+=a+" ";}else files.push_back(v[i]);}
 for(auto f:files){auto runs=load(f);Judge j;vector<double> de;
 for(auto&r:runs){int n=0;for(auto&g:r.segs){bool any=false;Pose A,C;Map m;vector<Pose> ps,ts;
  for(auto&x:g){if(x.tag=='W'){if(any){Pose p=comp(C,rel(A,x.B));if(P["usew"])m.enter(p,x.rays,.5);m.stand(p);}continue;}
   Pose p;
   if(!any){any=true;p=x.A;}
   else{p=comp(C,rel(A,{x.B.x,x.B.y,x.A.h}));p=match(m,p,x.rays,1);}
   C=p;A=x.A;m.enter(p,x.rays,1);m.stand(p);ps.push_back(p);ts.push_back(x.T);}
  j.run(n,ps,ts); if(ps.size()&&P["v"]){vector<double> o;for(size_t i=0;i<ps.size();i++)o.push_back(wrap(ps[i].h-ts[i].h-(ps[0].h-ts[0].h)));sort(o.begin(),o.end());double off=ps[0].h-ts[0].h+o[o.size()/2];Pose a0={ps[0].x,ps[0].y,ts[0].h+off};printf("%s:",r.key.substr(0,5).c_str());for(size_t i=0;i<ps.size();i++){Pose t=truth(a0,ts[0],ts[i]);printf(" (%.1f,%.1f)%+.1f,%+.1f",t.x,t.y,ps[i].x-t.x,ps[i].y-t.y);double hh=wrap(ps[i].h-t.h)*57.3;if(fabs(hh)>9)printf("h%+.0f",hh);}puts("");}}}
 string nm=string(f).substr(0,4)+" "+name;j.print(nm.c_str());fflush(stdout);}}
